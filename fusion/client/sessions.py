"""Sessions: the calls on a server or a local folder, blocking or awaited."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from fusion.client.drawing import Drawing
from fusion.client.fetching import Fetching
from fusion.client.here import HereDoing, HereDoingAsync
from fusion.client.place import Place
from fusion.client.reading import Reading
from fusion.client.sending import Sending
from fusion.client.steps import Awaiting, Blocking, run, run_async
from fusion.client.surfaces import Surfaces
from fusion.client.working import Working
from spcola.errors import InvalidValueError, WorkspaceError

if TYPE_CHECKING:
    from fusion.client.local import Local
    from fusion.client.remote import Remote

TOKEN_VARIABLE = "SPCOLA_TOKEN"
_SCHEMES = ("http://", "https://")


def connect(url_or_folder: str | Path, token: str = "", *, patience_s: float = 60.0) -> Session:
    """Open a session on a server, or on a folder of this machine without a server.

    Parameters
    ----------
    url_or_folder : str or Path
        ``http://…`` or ``https://…``, or a workspace, or a folder whose sub-folders are
        workspaces.
    token : str
        For the server; by default that of the variable ``SPCOLA_TOKEN``.
    patience_s : float
        How long a call waits for a server that does not answer.

    Returns
    -------
    Session
        To be closed, or used as a context.

    Raises
    ------
    SpcolaError
        If there is no such folder, the server does not answer, or the token is refused.

    Examples
    --------
    >>> with connect("http://localhost:8080") as session:  # doctest: +SKIP
    ...     job = session.submit("bennu", ["mapolas", "register"])
    ...     session.wait(job)
    ...     heights = session.window("bennu", "fused", "AB0001")
    """
    if not _is_url(url_or_folder):
        place = _local(url_or_folder)
        return Session(place, HereDoing, place.close)
    from fusion.client.transport import HttpDoing, blocking_client  # noqa: PLC0415

    url = _checked_url(str(url_or_folder))
    client = blocking_client(url, token or os.environ.get(TOKEN_VARIABLE, ""))
    remote = _remote(url, patience_s)
    session = Session(remote, lambda: HttpDoing(client), client.close)
    try:
        run(remote.asking.greet(), session.doing())
        session.workspaces()
    except BaseException:
        session.close()
        raise
    return session


async def connect_async(
    url_or_folder: str | Path, token: str = "", *, patience_s: float = 60.0
) -> AsyncSession:
    """Open a session whose calls are awaited.

    Parameters
    ----------
    url_or_folder : str or Path
    token : str
    patience_s : float
        As those of :func:`connect`.

    Raises
    ------
    SpcolaError
        If there is no such folder, the server does not answer, or the token is refused.
    """
    if not _is_url(url_or_folder):
        place = _local(url_or_folder)

        async def close() -> None:
            place.close()

        return AsyncSession(place, HereDoingAsync, close)
    from fusion.client.transport import HttpDoingAsync, awaiting_client  # noqa: PLC0415

    url = _checked_url(str(url_or_folder))
    client = awaiting_client(url, token or os.environ.get(TOKEN_VARIABLE, ""))
    remote = _remote(url, patience_s)
    session = AsyncSession(remote, lambda: HttpDoingAsync(client), client.aclose)
    try:
        await run_async(remote.asking.greet(), session.doing())
        await session.workspaces()
    except BaseException:
        await session.close()
        raise
    return session


class _Calls(Reading, Surfaces, Drawing, Working, Sending, Fetching):
    """All calls on a server or a local folder.

    Parameters
    ----------
    place : Place
        The server or the folder.
    doing : callable
        Returns what does the steps of one call.
    close : callable
        Closes the connections.
    """

    def __init__(self, place: Place, doing: Any, close: Any) -> None:
        self.place = place
        self.doing = doing
        self._close = close


class Session(_Calls, Blocking):
    """The calls on a server or a local folder; each blocks until its result is there.

    :func:`connect` makes one. It is a context: jobs that a local folder's session has submitted
    go on as long as it is open.
    """

    def close(self) -> None:
        """Close connections; of a local folder the worker finishes its current items."""
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class AsyncSession(_Calls, Awaiting):
    """The calls on a server or a local folder, to be awaited: ``await session.overview("bennu")``.

    :func:`connect_async` makes one; ``async for event in session.events(job)`` iterates.
    """

    async def close(self) -> None:
        """Close connections; of a local folder the worker finishes its current items."""
        await self._close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


def _is_url(text: str | Path) -> bool:
    return str(text).lower().startswith(_SCHEMES)


def _checked_url(url: str) -> str:
    """Return an address without the slash at its end."""
    if "?" in url or "#" in url or "@" in url:
        raise InvalidValueError("is an address with more than host, port and path", url)
    return url.rstrip("/")


def _local(folder: str | Path) -> Local:
    from fusion.client.local import Local  # noqa: PLC0415

    if not Path(folder).is_dir():
        raise WorkspaceError("is not a folder", folder, "give a folder, or http://HOST:PORT")
    return Local(Path(folder))


def _remote(url: str, patience_s: float) -> Remote:
    from fusion.client.asking import Asking  # noqa: PLC0415
    from fusion.client.remote import Remote  # noqa: PLC0415

    return Remote(Asking(url, patience_s))
