"""Routes of the page: its files, which hold no data; the page asks the interface for these."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from fusion.service.api.access import PUBLIC, Routes
from fusion.service.api.files import file_answer
from fusion.service.api.guard import PAGE_POLICY

routes = Routes("", "page")
_BUILT = Path(str(files("fusion.service"))) / "page" / "static"
_NOT_BUILT = (
    "<!doctype html><html lang=en><title>SPCOLA</title><p>The page is not built: run scripts/page. "
    "The interface is at <a href=/api/v1/openapi.json>/api/v1</a>.</p></html>"
)


@routes.add("GET", "/", PUBLIC, include_in_schema=False)
def page(request: Request) -> Response:
    """Return the page."""
    if not (_BUILT / "index.html").is_file():
        return HTMLResponse(_NOT_BUILT)
    return _built(request, "index.html")


@routes.add("GET", "/static/{path:path}", PUBLIC, include_in_schema=False)
def page_file(request: Request, path: str) -> Response:
    """Return a script, a style or a picture of the page."""
    return _built(request, path)


def _built(request: Request, name: str) -> Response:
    answer = file_answer(request, _BUILT, name)
    answer.headers["Content-Security-Policy"] = PAGE_POLICY
    return answer
