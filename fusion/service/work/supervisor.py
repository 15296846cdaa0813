"""The supervisor: keeps a number of worker processes running."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from fusion.service.work.logs import log

_LOOK_S = 0.2
_HEARTBEAT_S = 60.0
_STEADY_S = 10.0
_LONGEST_PAUSE_S = 60.0


@dataclass
class _Slot:
    """A worker's place: the process in it, its last sign of life, and its starts in sequence."""

    name: str
    process: subprocess.Popen[bytes]
    life: int
    beats: int
    begun: float = field(default_factory=time.monotonic)
    last: float = field(default_factory=time.monotonic)

    def look(self) -> None:
        """Take note of signs of life."""
        with suppress(BlockingIOError):
            if os.read(self.beats, 1 << 16):
                self.last = time.monotonic()

    def close(self) -> None:
        os.close(self.life)
        os.close(self.beats)


class Supervisor:
    """Starts worker processes, starts them again when they end, and drains them.

    Parameters
    ----------
    command : sequence of str
        Of a worker; its name and the descriptors of two pipes are added: one whose other end
        closes when the supervisor is gone, and one for signs of life.
    count : int
        Number of workers.
    lost : callable
        Takes the name of a worker that ended before it was drained, so that its job waits again
        at once.
    drain_s : float
        How long drained workers may finish their items before they are killed.
    silent_s : float
        A worker without a sign of life for so long is killed: a library hangs in it.
    quiet : bool
        The workers print nothing; their logs are in files.
    """

    def __init__(
        self,
        command: Sequence[str],
        count: int,
        *,
        lost: Callable[[str], None] = lambda _: None,
        drain_s: float = 60.0,
        silent_s: float = 300.0,
        quiet: bool = False,
    ) -> None:
        self._command, self._lost = list(command), lost
        self._drain_s, self._silent_s = drain_s, silent_s
        self._errors = subprocess.DEVNULL if quiet else None
        self._slots: list[_Slot | None] = [None] * count
        self._quick = [0] * count
        self.count, self.ended = count, 0
        self._due = [0.0] * count
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="supervisor", daemon=True)

    def start(self) -> None:
        """Start the workers, and watch them from a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Drain the workers: they finish their current items. Kill those that take too long."""
        self._stopping.set()
        self._thread.join()

    def run(self) -> None:
        """Keep the workers running until SIGTERM or Ctrl-C, then drain; in the main thread only."""
        for one in (signal.SIGTERM, signal.SIGINT):
            signal.signal(one, lambda *_: self._ask_to_stop())
        self.start()
        while self._thread.is_alive():
            self._thread.join(_LOOK_S)

    @property
    def workers(self) -> dict[str, int]:
        """The process number of each running worker, by its name."""
        return {slot.name: slot.process.pid for slot in self._slots if slot is not None}

    def _ask_to_stop(self) -> None:
        # Not from the handler itself: it may have interrupted the event's own lock.
        threading.Thread(target=self._stopping.set, daemon=True).start()

    def _watch(self) -> None:
        beat = time.monotonic()
        while not self._stopping.wait(_LOOK_S):
            for place in range(self.count):
                self._look(place)
            if time.monotonic() - beat >= _HEARTBEAT_S:
                beat = time.monotonic()
                log.info("heartbeat", workers=self.workers)
        self._drain()

    def _look(self, place: int) -> None:
        """Start the worker of a place if there is none; end one that hangs."""
        slot, now = self._slots[place], time.monotonic()
        if slot is None:
            if now >= self._due[place]:
                self._slots[place] = self._started()
            return
        slot.look()
        if slot.process.poll() is None:
            if now - slot.last > self._silent_s:
                log.error("a worker hangs: it is killed", worker=slot.name)
                _kill(slot.process)
            return
        self._ended(place, slot)

    def _started(self) -> _Slot | None:
        name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
        theirs, life = os.pipe()
        beats, theirs_too = os.pipe()
        os.set_blocking(beats, False)
        try:
            process = subprocess.Popen(
                [*self._command, name, str(theirs), str(theirs_too)],
                pass_fds=(theirs, theirs_too),
                stdin=subprocess.DEVNULL,
                stderr=self._errors,
                # Ctrl-C at the terminal reaches the supervisor only.
                start_new_session=True,
            )
        except OSError as error:
            log.error("a worker cannot be started", error=str(error))
            os.close(life)
            os.close(beats)
            return None
        finally:
            os.close(theirs)
            os.close(theirs_too)
        log.info("worker started", worker=name, process_id=process.pid)
        return _Slot(name, process, life, beats)

    def _ended(self, place: int, slot: _Slot) -> None:
        """Report a worker that ended, and when the next one starts: later each time it is quick."""
        self._slots[place] = None
        self.ended += 1
        slot.close()
        quick = time.monotonic() - slot.begun < _STEADY_S
        self._quick[place] = self._quick[place] + 1 if quick else 0
        pause = min(2.0 ** (self._quick[place] - 1), _LONGEST_PAUSE_S) if quick else 0.0
        self._due[place] = time.monotonic() + pause
        log.error("a worker ended", worker=slot.name, code=slot.process.returncode, again_s=pause)
        self._report_lost(slot.name)

    def _report_lost(self, name: str) -> None:
        try:
            self._lost(name)
        except Exception as error:
            # Its lease ends in any case.
            log.warning("the end of a worker was not recorded", worker=name, error=str(error))

    def _drain(self) -> None:
        slots = [slot for slot in self._slots if slot is not None]
        log.info("drain", workers=[slot.name for slot in slots], within_s=self._drain_s)
        for slot in slots:
            slot.process.send_signal(signal.SIGTERM)
        until = time.monotonic() + self._drain_s
        for slot in slots:
            try:
                slot.process.wait(max(0.0, until - time.monotonic()))
            except subprocess.TimeoutExpired:
                log.warning("a worker is killed", worker=slot.name)
                _kill(slot.process)
            if slot.process.returncode:
                self._report_lost(slot.name)
            slot.close()
        self._slots = [None] * self.count
        log.info("drained")


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a worker and what it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
