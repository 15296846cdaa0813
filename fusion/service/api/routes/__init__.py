"""The routes of the interface, by subject."""

from fusion.service.api.routes import (
    admin,
    jobs,
    outputs,
    page,
    process,
    results,
    surfaces,
    uploads,
    workspaces,
)

ROUTES = (
    process.routes,
    workspaces.routes,
    jobs.routes,
    uploads.routes,
    surfaces.routes,
    results.routes,
    outputs.routes,
    admin.routes,
    page.routes,
)

__all__ = ["ROUTES"]
