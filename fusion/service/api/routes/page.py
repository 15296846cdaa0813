"""Routes of the page: its files, which hold no data; the page asks the interface for these."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from fusion.service.api.access import PUBLIC, Routes
from fusion.service.api.files import file_answer
from fusion.service.api.guard import PAGE_POLICY
from fusion.service.page import STATIC, is_built

routes = Routes("", "page")
_KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
# A file with the digest of its content in its name never changes.
_HASHED = re.compile(r"-[0-9A-Z]{8}\.(js|css)$")
_YEAR = "public, max-age=31536000, immutable"
_NOT_BUILT = (
    "<!doctype html><html lang=en><title>SPCOLA</title><p>The page is not built. In a checkout of "
    "SPCOLA run <code>scripts/page</code>, then load this again; an installed wheel contains it. "
    "The interface works without: <a href=/api/v1/openapi.json>/api/v1/openapi.json</a>.</html>"
)


@routes.add("GET", "/", PUBLIC, include_in_schema=False)
def page(request: Request) -> Response:
    """Return the page."""
    if not is_built():
        return HTMLResponse(_NOT_BUILT, 503, {"Cache-Control": "no-store"})
    return _built(request, "index.html")


@routes.add("GET", "/static/{path:path}", PUBLIC, include_in_schema=False)
def page_file(request: Request, path: str) -> Response:
    """Return a script or a style of the page."""
    return _built(request, path)


def _built(request: Request, name: str) -> Response:
    answer = file_answer(request, STATIC, name)
    answer.headers["Content-Security-Policy"] = PAGE_POLICY
    answer.headers["Cache-Control"] = _YEAR if _HASHED.search(name) else "no-cache"
    del answer.headers["Content-Disposition"]
    if kind := _KINDS.get(PurePosixPath(name).suffix):
        # The machine's own table of types may have others.
        answer.headers["Content-Type"] = f"{kind}; charset=utf-8"
    return answer
