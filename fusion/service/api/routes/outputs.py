"""Routes of outputs: files that jobs write for their users, outside of the workspace."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path as PathPart
from starlette.requests import Request
from starlette.responses import Response

from fusion.service.api.access import READ, RUN, Routes
from fusion.service.api.answers import json_answer
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.files import file_answer
from fusion.service.api.pages import After, Limit, page_of
from fusion.service.api.schemas import results, work
from fusion.service.api.service import service_of
from fusion.service.state import outputs_folder
from fusion.service.work.places import output_files
from fusion.service.work.places import remove_output as remove_files

routes = Routes("/api/v1/workspaces/{workspace}/outputs", "outputs")

Name = Annotated[str, PathPart(pattern=r"^[A-Za-z0-9][A-Za-z0-9._+-]{0,127}$")]


@routes.add("GET", "", READ, work.OUTPUTS)
def outputs(request: Request, workspace: str, after: After = "", limit: Limit = 100) -> Response:
    """List the files that jobs have written for their users: kernels, cameras, exports, pages."""
    service = service_of(request)
    service.folder(workspace)
    sizes = output_files(service.root, workspace)
    shown, more = page_of(request, sorted(sizes), after, limit)
    return json_answer(
        request, {"outputs": [{"name": name, "bytes": sizes[name]} for name in shown]}, more
    )


@routes.add("GET", "/{path:path}", READ, results.FILE)
def output(request: Request, workspace: str, path: str) -> Response:
    """Return an output, or a range of its bytes."""
    service = service_of(request)
    service.folder(workspace)
    return file_answer(request, outputs_folder(service.root, workspace), path)


@routes.add("DELETE", "/{name}", RUN, status_code=204)
def remove_output(request: Request, workspace: str, name: Name) -> Response:
    """Remove an output: a file, or a folder with all that is in it."""
    service = service_of(request)
    service.folder(workspace)
    if not remove_files(service.root, workspace, name):
        raise RequestRefusedError(Refusal.NOT_FOUND, "there is no such output", name)
    return Response(status_code=204)
