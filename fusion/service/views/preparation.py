"""What takes long to make is made before anybody asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from fusion.service.views.body import PAGE_FACETS, shape_bytes, shape_layers, vertex_layer
from fusion.service.views.outlines import OUTLINED, outlines
from fusion.service.views.overview import coverage, overview
from fusion.service.views.surfaces import LayerCache
from fusion.workspace import Workspace

__all__ = ["preparations"]


def preparations(
    workspace: Workspace, cache: LayerCache
) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield, with its name, each view of the page that is kept in files; calling it makes it.

    Parameters
    ----------
    workspace : Workspace
    cache : LayerCache
        With a folder.

    Raises
    ------
    SpcolaError
        If a folder cannot be listed.
    """
    yield "overview", lambda: overview(workspace)
    yield "coverage", lambda: coverage(workspace)
    yield "outlines", lambda: [outlines(workspace, kind, cache=cache) for kind in OUTLINED]
    yield "shape", lambda: shape_bytes(workspace, PAGE_FACETS, cache=cache)
    for layer in shape_layers(workspace):
        name = str(layer["name"])
        yield name, partial(vertex_layer, workspace, name, PAGE_FACETS, cache=cache)
