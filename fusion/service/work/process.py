"""A worker process: ``python -m fusion.service.work.process`` with its settings as JSON."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from fusion.runtime.children import end_with_parent
from fusion.runtime.processes import ProcessLimits
from fusion.service.state import logs_folder
from fusion.service.store import Store
from fusion.service.tracing import start_tracing
from fusion.service.work.logs import start_log
from fusion.service.work.options import WorkOptions
from fusion.service.work.worker import work

STORE_VARIABLE = "SPCOLA_STORE"
_NICE = 10


def worker_command(folder: Path, store: str | Path, options: WorkOptions) -> list[str]:
    """Return the command of a worker process; the name of the worker is added to it.

    A store that the environment names is not in it: all users of a machine see commands, and the
    URL may contain a password.

    Parameters
    ----------
    folder : Path
        That of the service.
    store : str or Path
        As of :class:`fusion.service.store.Store`.
    options : WorkOptions
    """
    store = "" if str(store) == os.environ.get(STORE_VARIABLE) else store
    content = json.dumps({"folder": str(folder), "store": str(store), "options": asdict(options)})
    return [sys.executable, "-m", "fusion.service.work.process", content]


def run_worker(
    folder: Path,
    store: str | Path,
    options: WorkOptions,
    *,
    name: str,
    beat: Callable[[], None] = lambda: None,
) -> None:
    """Open the store and do jobs until SIGTERM; logs go to ``.service/logs``.

    Parameters
    ----------
    folder : Path
        That of the service.
    store : str or Path
        As of :class:`fusion.service.store.Store`.
    options : WorkOptions
    name : str
    beat : callable
        As of :func:`work`.
    """
    start_log(logs_folder(folder), name)
    with start_tracing(name), Store(store) as opened:
        work(opened, folder, options, name=name, upload=opened.uploads.get, beat=beat)


def main(arguments: list[str]) -> None:
    """Run a worker whose supervisor has the other ends of two pipes."""
    content, name, life, beats = arguments
    # Drained when the supervisor is gone: the next one starts workers of its own.
    end_with_parent(int(life), signal.SIGTERM)
    given = json.loads(content)
    limits = ProcessLimits(**given["options"].pop("limits"))
    options = WorkOptions(**given["options"], limits=limits)

    def beat() -> None:
        # A pipe that is full is a sign of life too.
        with suppress(OSError):
            os.write(int(beats), b".")

    os.set_blocking(int(beats), False)
    # Where all cores are busy with jobs, people who ask come first.
    os.nice(_NICE)
    store = given["store"] or os.environ[STORE_VARIABLE]
    run_worker(Path(given["folder"]), store, options, name=name, beat=beat)


if __name__ == "__main__":
    main(sys.argv[1:])
