"""The routes of the interface, by subject."""

from fusion.service.api.routes import admin, jobs, page, process, uploads

ROUTES = (process.routes, jobs.routes, uploads.routes, admin.routes, page.routes)

__all__ = ["ROUTES"]
