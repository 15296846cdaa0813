"""The views of a workspace are made ready after its jobs, by a process that gives way to others."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from fusion.runtime.children import end_with_parent
from fusion.service.api import ServedFolder, Service
from fusion.service.jobs import Event, JobState
from fusion.service.state import cache_folder, logs_folder
from fusion.service.views import ListKind, list_page, overview
from fusion.service.views.preparation import preparations
from fusion.service.views.surfaces import (
    LayerCache,
    SurfaceKind,
    open_surface,
    png_of,
    surface_names,
)
from fusion.service.work.logs import log, start_log
from spcola.errors import SpcolaError

_NICE = 15
_POLL_S = 0.2
# Results written this shortly before may still change unnoticed: they are not remembered yet.
_QUIET_S = 2.0
# Scans that the page asks for first: the checksum of each takes a hundredth of a second.
_FIRST_PAGE = 50
# With fewer maplets and a smaller shape file, views are made before that process has started.
_MANY_MAPLETS, _LARGE_SHAPE = 100, 1 << 20


class Preparer:
    """Makes views of large workspaces ready: at the start, then of each whose job has ended.

    Parameters
    ----------
    service : Service
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._waiting: set[str] = set(service.names())
        self._news, self._stopping = threading.Event(), threading.Event()
        self._news.set()
        self._thread = threading.Thread(target=self._run, name="preparer", daemon=True)

    def __enter__(self) -> Self:
        self._service.feed.listeners.append(self.heed)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._service.feed.listeners.remove(self.heed)
        self._stopping.set()
        self._news.set()
        self._thread.join()

    def heed(self, event: Event) -> None:
        """Have the workspace of a job that has ended made ready."""
        if event.kind == "state" and JobState(event.content["state"]).ended:
            self._waiting.add(event.workspace)
            self._news.set()

    def _run(self) -> None:
        self._warm_up()
        while not self._stopping.is_set():
            self._news.wait()
            if self._stopping.wait(_QUIET_S):
                return
            self._news.clear()
            names, self._waiting = self._waiting, set()
            try:
                self._prepare([name for name in sorted(names) if self._is_large(name)])
            except OSError as error:
                log.warning("views cannot be made ready", error=str(error))

    def _warm_up(self) -> None:
        """Read some views in this process: modules are loaded before anybody waits for them.

        Modules for drawing are loaded two seconds later: those who waited for the start come first.
        """
        for name in sorted(self._waiting)[:1]:
            with suppress(SpcolaError, OSError):
                workspace = self._service.workspace(name)
                overview(workspace)
                list_page(workspace, ListKind.SCANS, limit=_FIRST_PAGE)
                if self._stopping.wait(_QUIET_S):
                    return
                for maplet in surface_names(workspace, SurfaceKind.MAPLET)[:1]:
                    shown = open_surface(workspace, SurfaceKind.MAPLET, maplet)
                    shown.describe()
                    png_of(shown.tile("height", 1, 0, 0), "height", (0.0, 1.0))

    def _is_large(self, name: str) -> bool:
        """Return whether views of a workspace take long to make."""
        with suppress(SpcolaError):
            workspace = self._service.workspace(name)
            if len(workspace.maplet_names()) >= _MANY_MAPLETS:
                return True
            return workspace.has_shape() and workspace.shape_path().stat().st_size >= _LARGE_SHAPE
        return False

    def _prepare(self, names: list[str]) -> None:
        """Run the process until it ends, or the service does; not at all without names."""
        if not names:
            return
        command = [sys.executable, "-m", __name__, str(self._service.root), *names]
        with subprocess.Popen(
            command,
            # Its other end is gone when this process is.
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as process:
            while process.poll() is None:
                if self._stopping.wait(_POLL_S):
                    process.kill()


def prepare(folder: Path, names: Iterable[str]) -> None:
    """Make the views of workspaces in a folder ready.

    What cannot be made is noted in the log; whoever asks for it gets the reason.

    Parameters
    ----------
    folder : Path
        That of the service.
    names : iterable of str
        Of the workspaces.
    """
    served = ServedFolder(folder)
    for name in names:
        # One workspace at a time is in memory.
        cache = LayerCache(folder=cache_folder(served.root))
        try:
            for what, make in preparations(served.workspace(name), cache):
                with suppress(SpcolaError):
                    make()
                    log.info("view is ready", workspace=name, view=what)
        except SpcolaError as error:
            log.warning("views cannot be made ready", workspace=name, error=str(error))


def main(arguments: list[str]) -> None:
    """Make views ready as long as the parent process lives."""
    end_with_parent(sys.stdin.fileno())
    os.nice(_NICE)
    folder, *names = arguments
    start_log(logs_folder(Path(folder)), "preparer")
    prepare(Path(folder), names)


if __name__ == "__main__":
    main(sys.argv[1:])
