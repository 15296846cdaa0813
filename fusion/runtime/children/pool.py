"""Executor on child processes of this machine: the death of one costs a try of its item."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import Pipe
from typing import Any, Self, TypeVar

import cloudpickle

from fusion.runtime.children.child import ERROR, MEMORY
from fusion.runtime.children.item_run import ItemRun
from fusion.runtime.children.payload import Payload
from fusion.runtime.children.poisonous import PoisonousItemError, item_name
from fusion.runtime.executor import AHEAD, ThreadExecutor
from fusion.runtime.processes import ProcessLimits
from spcola.errors import SpcolaError

Item = TypeVar("Item")
Result = TypeVar("Result")

TRIES = 3
"""Processes that one item may end."""
_START = "from fusion.runtime.children.child import serve; serve({}, {}, {})"
_START_S = 120.0


class _DiedError(Exception):
    """A child ended, or was ended, before it answered; the text says how."""


class _NotStartedError(_DiedError):
    """A child ended before it took an item."""


class ProcessExecutor:
    """Runs calls in child processes, one item at a time in each.

    The function is sent to a child once, an item and its result with each call. If a child dies,
    its item alone is tried again, in a new one; results do not change. The first error, or Ctrl-C,
    cancels what has not begun and waits for what has, as on threads. Children live until the
    executor is closed or its process ends, however it ends.

    Parameters
    ----------
    workers : int, optional
        Number of children; by default the cores that this process may use.
    limits : ProcessLimits, optional
        Memory of a child, and time for an item; a child that exceeds them is ended.
    tries : int
        Children that one item may end.
    seen : callable, optional
        Takes what became of each item, from the thread that waited for it.
    """

    def __init__(
        self,
        workers: int | None = None,
        *,
        limits: ProcessLimits | None = None,
        tries: int = TRIES,
        seen: Callable[[ItemRun], None] | None = None,
    ) -> None:
        self._threads = ThreadExecutor(workers)
        self.workers = self._threads.workers
        self._limits, self._tries, self._seen = limits, tries, seen
        self._children: set[_Child] = set()
        self._idle: list[_Child] = []
        self._lock = threading.Lock()
        self._is_closed = False
        self._finalize = weakref.finalize(self, _end_all, self._children)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all children."""
        with self._lock:
            self._is_closed = True
            self._idle.clear()
            self._finalize()

    def stream(
        self, function: Callable[[Item], Result], items: Iterable[Item], *, ahead: int = AHEAD
    ) -> Iterator[Result]:
        """Yield the results in the order of `items`; see :class:`fusion.runtime.Executor`.

        Raises
        ------
        PoisonousItemError
            If children died of an item as often as it was tried; it names the item.
        SpcolaError
            If children cannot be started.
        """
        # A thread for each child waits for its answers.
        return self._threads.stream(partial(self._done, Payload.of(function)), items, ahead=ahead)

    def _done(self, payload: Payload, item: Any) -> Any:
        """Return the result of an item, and report what became of it."""
        begun, deaths, error = time.monotonic(), list[str](), ""
        try:
            return self._tried(payload, item, deaths)
        except BaseException as raised:
            error = type(raised).__name__
            raise
        finally:
            if self._seen is not None:
                seconds = time.monotonic() - begun
                self._seen(ItemRun(item_name(item), seconds, tuple(deaths), error))

    def _tried(self, payload: Payload, item: Any, deaths: list[str]) -> Any:
        """Return the result of an item; add to `deaths` how each of its processes ended."""
        message, last = cloudpickle.dumps(item), _DiedError()
        for _ in range(self._tries):
            try:
                with self._child() as child:
                    kind, value = child.answer(payload, message)
            except _DiedError as death:
                last = death
                deaths.append(str(death))
                continue
            if kind == ERROR:
                raise value
            return value
        if isinstance(last, _NotStartedError):
            raise SpcolaError(str(last), "work", "allow more memory, or see what it printed")
        advice = "it is damaged, made to do harm, or needs more memory or time"
        raise PoisonousItemError(item_name(item), self._tries, str(last), advice)

    @contextmanager
    def _child(self) -> Iterator[_Child]:
        """Lend an idle child, or a new one; one that died is not lent again."""
        child = self._taken() or self._started()
        try:
            yield child
        except BaseException:
            child.end()
            with self._lock:
                self._children.discard(child)
            raise
        with self._lock:
            self._idle.append(child)

    def _taken(self) -> _Child | None:
        with self._lock:
            while self._idle:
                child = self._idle.pop()
                if child.is_alive():
                    return child
                self._children.discard(child)
        return None

    def _started(self) -> _Child:
        with self._lock:
            if self._is_closed:
                raise SpcolaError("the child processes were ended", "work")
            child = _Child(self._limits)
            self._children.add(child)
        return child


class _Child:
    """A child process, and the connection to it."""

    def __init__(self, limits: ProcessLimits | None) -> None:
        self._limits, self._digest, self._is_ready = limits, "", False
        self._connection, theirs = Pipe()
        parent, self._life = os.pipe()
        memory_mb = 0 if limits is None else limits.memory_mb
        paths = os.pathsep.join(path for path in sys.path if path)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _START.format(theirs.fileno(), parent, memory_mb)],
                pass_fds=(theirs.fileno(), parent),
                stdin=subprocess.DEVNULL,
                # Standard output is left to results.
                stdout=2,
                env={**os.environ, "PYTHONPATH": paths},
                # Ctrl-C at the terminal reaches the parent only.
                start_new_session=True,
            )
        except OSError as error:
            self._connection.close()
            os.close(self._life)
            raise SpcolaError(
                f"a child process cannot be started ({error.strerror})", "work"
            ) from error
        finally:
            theirs.close()
            os.close(parent)

    def is_alive(self) -> bool:
        """Return whether the process runs."""
        return self._process.poll() is None

    def answer(self, payload: Payload, item: bytes) -> tuple[str, Any]:
        """Return what came out for a pickled item.

        Raises
        ------
        _DiedError
            If the child ended, or exceeded its limits.
        """
        if not self._is_ready:
            self._await_start()
        content = b"" if payload.digest == self._digest else payload.content
        self._digest = payload.digest
        try:
            self._connection.send_bytes(pickle.dumps((content, payload.digest, item)))
            kind, value = self._received()
        except (EOFError, OSError) as error:
            raise _DiedError(self._how()) from error
        if kind == MEMORY:
            # What is left of its memory is not known: the next item gets another process.
            raise _DiedError(f"out of memory{self._limit_text()}")
        return kind, value

    def _received(self) -> tuple[str, Any]:
        """Return the next answer, waiting for it no longer than allowed."""
        seconds = None if self._limits is None else self._limits.seconds
        if not self._connection.poll(seconds):
            raise _DiedError(f"it took more than {seconds:g} s")
        answer: tuple[str, Any] = pickle.loads(self._connection.recv_bytes())
        return answer

    def _await_start(self) -> None:
        try:
            self._is_ready = self._connection.poll(_START_S) and bool(self._connection.recv_bytes())
        except (EOFError, OSError):
            self._is_ready = False
        if not self._is_ready:
            text = f"a child process did not start: {self._how()}{self._limit_text()}"
            raise _NotStartedError(text)

    def _how(self) -> str:
        """Return how the process ended."""
        self.end(patience_s=1.0)
        code = self._process.returncode
        if code >= 0:
            return f"it ended with exit code {code}"
        with suppress(ValueError):
            return f"signal {-code} ({signal.Signals(-code).name})"
        return f"signal {-code}"

    def _limit_text(self) -> str:
        return "" if self._limits is None else f" (limit {self._limits.memory_mb} MB)"

    def end(self, patience_s: float = 0.0) -> None:
        """End the process and what it started; one that is ending by itself has some time to."""
        if patience_s:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(patience_s)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._connection.close()
        if self._life >= 0:
            os.close(self._life)
            self._life = -1


def _end_all(children: set[_Child]) -> None:
    for child in children:
        child.end()
    children.clear()
