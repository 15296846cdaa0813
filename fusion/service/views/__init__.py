"""What the service, its page and its client read of a workspace: values and arrays, no HTTP.

Each module is a subject: this room has the overview, :mod:`~fusion.service.views.surfaces` windows
of maplets and bigmaps, :mod:`~fusion.service.views.body` the shape,
:mod:`~fusion.service.views.results` and :mod:`~fusion.service.views.tables` numbers,
:mod:`~fusion.service.views.history` solutions, runs and provenance.
"""

from fusion.service.views.lists import ListKind, Page, list_page
from fusion.service.views.overview import coverage, overview, workspace_etag

__all__ = ["ListKind", "Page", "coverage", "list_page", "overview", "workspace_etag"]
