"""Files of a workspace: opened without following links, sent whole or as one range of bytes."""

from __future__ import annotations

import mimetypes
import os
import stat
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from fusion.service.api.answers import matches
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.state import visible_file

_BLOCK = 1 << 18
_SMALL = 1 << 20
# A report may show itself, but runs nothing and asks nobody: it is not the service's page.
_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data: 'self'"
_SHOWN = {"text/html", "image/png", "image/jpeg", "image/svg+xml", "text/plain", "application/json"}


def file_answer(request: Request, root: Path, name: str) -> Response:
    """Return a file below `root`, or the range of it that is asked for.

    Raises
    ------
    RequestRefusedError
        If there is no such file, its name or a folder's begins with a dot, a link leads out of
        `root`, or the range lies outside of it.
    """
    with ExitStack() as closing:
        file = closing.enter_context(_opened(root, name))
        status = os.fstat(file.fileno())
        tag = f'"{status.st_mtime_ns:x}-{status.st_size:x}-{status.st_ino:x}"'
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        headers = _headers(PurePosixPath(name).name, tag, kind)
        if matches(request.headers.get("if-none-match", ""), tag):
            return Response(status_code=304, headers=headers)
        whole = request.headers.get("if-range", tag) != tag
        part = None if whole else byte_range(request.headers.get("range", ""), status.st_size)
        first, last = part or (0, status.st_size - 1)
        headers["Content-Length"] = str(last - first + 1)
        if part is not None:
            headers["Content-Range"] = f"bytes {first}-{last}/{status.st_size}"
        code = 200 if part is None else 206
        if last - first < _SMALL:
            # Read here: each block would wait for a thread of its own.
            return Response(b"".join(_blocks(file, first, last)), code, headers, kind)
        closing.pop_all()
        return StreamingResponse(_blocks(file, first, last), code, headers, kind)


def byte_range(header: str, size: int) -> tuple[int, int] | None:
    """Return first and last byte of a header Range; None for the whole file.

    Several ranges at once, and units other than bytes, get the whole file, as RFC 9110 allows.

    Raises
    ------
    RequestRefusedError
        If it lies outside of a file of `size` bytes.
    """
    unit, _, text = header.partition("=")
    begin, dash, end = (part.strip() for part in text.partition("-"))
    known = unit.strip().lower() == "bytes" and dash and begin + end and "," not in text
    if not known or not all(part.isdecimal() and part.isascii() for part in (begin, end) if part):
        return None
    first = int(begin) if begin else max(0, size - int(end))
    last = min(int(end), size - 1) if begin and end else size - 1
    if begin and end and int(end) < first:
        return None
    if first >= size or (not begin and not int(end)):
        raise RequestRefusedError(
            Refusal.RANGE_NOT_SATISFIABLE, f"lies outside of {size} bytes", "Range"
        )
    return first, last


def _opened(root: Path, name: str) -> BinaryIO:
    """Open a file below `root` that no hidden name and no link out of it leads to."""
    missing = RequestRefusedError(Refusal.NOT_FOUND, "there is no such file", name)
    path = visible_file(root, name)
    if path is None:
        raise missing
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        raise missing from error
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise missing
    return os.fdopen(handle, "rb")


def _headers(name: str, tag: str, kind: str) -> dict[str, str]:
    safe = "".join(c if c.isascii() and c.isprintable() and c not in '"\\' else "_" for c in name)
    shown = "inline" if kind in _SHOWN else "attachment"
    return {
        "ETag": tag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "private, no-cache",
        "Content-Security-Policy": _POLICY,
        "Content-Disposition": f'{shown}; filename="{safe}"',
    }


def _blocks(file: BinaryIO, first: int, last: int) -> Iterator[bytes]:
    """Yield bytes of an open file, and close it."""
    with file:
        file.seek(first)
        left = last - first + 1
        while left > 0 and (block := file.read(min(_BLOCK, left))):
            left -= len(block)
            yield block
