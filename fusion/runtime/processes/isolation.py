"""Commands that read foreign files, in a separate process with limits.

Readers bound their work by a file's length, but libraries for HDF5, LAZ or SPICE are native code:
a malicious file may crash their process, hang it, or fill the memory. So the whole command runs
again as a child process, not one reader in it: no value has to pass between processes, every
library of the command is covered, and the child's locks and clean-up are those of any killed
command. Its output goes where the parent's goes.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from spcola.errors import InvalidValueError, SpcolaError

LIMITS_VARIABLE = "SPCOLA_LIMITS"
_PARTS = "*.part"
_PATIENCE_S = 10.0
"""How long an interrupted child may take to tidy up."""


@dataclass(frozen=True)
class ProcessLimits:
    """Memory and time that a child process may use.

    Parameters
    ----------
    memory_mb : int
        Address space: what it reserves, which is more than it uses.
    seconds : float
        Time from start to end.

    Raises
    ------
    InvalidValueError
        If the program itself needs more memory, or the time is not positive.
    """

    memory_mb: int = 8192
    seconds: float = 3600.0

    def __post_init__(self) -> None:
        if not 2048 <= self.memory_mb <= 1 << 24:
            raise InvalidValueError("must be 2048 MB to 16 TB", "--limit-mb")
        if not 1.0 <= self.seconds <= 1e7:
            raise InvalidValueError("must be 1 s to 1e7 s", "--limit-s")


def isolated(arguments: Sequence[str], limits: ProcessLimits, *folder: Path) -> int:
    """Run ``spcola ARGUMENTS`` in a child process; return its exit code.

    Standard output is that of this process. Standard error is passed on after the child ended by
    itself; at once if it is a terminal.

    Parameters
    ----------
    arguments : sequence of str
        A command and its options.
    limits : ProcessLimits
    *folder : Path
        Where it writes: files that were incomplete when it died are removed.

    Raises
    ------
    SpcolaError
        If it died, or was stopped because it took too long.
    """
    before = _parts(folder)
    errors = None if sys.stderr.isatty() else tempfile.TemporaryFile()  # noqa: SIM115 (closed below)
    environment = {**os.environ, LIMITS_VARIABLE: f"{limits.memory_mb} {limits.seconds:.0f}"}
    # A new session: Ctrl-C at the terminal reaches this process only, which passes it on once.
    child = subprocess.Popen(
        [sys.executable, "-m", "fusion.cli", *arguments],
        stderr=errors,
        env=environment,
        start_new_session=True,
    )
    try:
        code, what = _ended(child, limits)
        if what:
            for path in _parts(folder) - before:
                path.unlink(missing_ok=True)
            raise SpcolaError(
                f"{what}, and what it was writing was removed",
                f"spcola {arguments[0]}",
                "a file is damaged or made to do harm, or needs a higher --limit-mb or --limit-s",
            )
        if errors is not None:
            errors.seek(0)
            os.write(2, errors.read())
        return code
    finally:
        if errors is not None:
            errors.close()


def apply_limits() -> None:
    """Set the limits of this process, a child of :func:`isolated`; none in any other process.

    The child sets them itself, first of all: code between fork and exec is not safe in a parent
    with threads.
    """
    stated = os.environ.pop(LIMITS_VARIABLE, "")
    if not stated:
        return
    memory_mb, seconds = map(int, stated.split())
    # The parent, which keeps the time, may be gone.
    limit_process(memory_mb, seconds * (os.cpu_count() or 1))


def limit_process(memory_mb: int, cpu_s: int = 0) -> None:
    """Limit address space and processor time of this process, for good; 0 for no limit."""
    for kind, most in (
        (resource.RLIMIT_AS, memory_mb << 20),
        (resource.RLIMIT_CPU, cpu_s),
        (resource.RLIMIT_CORE, 0),
    ):
        if most or kind == resource.RLIMIT_CORE:
            hard = resource.getrlimit(kind)[1]
            least = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (least, least))


@contextmanager
def limited_memory(memory_mb: int) -> Iterator[None]:
    """Limit the address space of this process as long as the context is open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = memory_mb << 20
    least = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_AS, (least, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _ended(child: subprocess.Popen[bytes], limits: ProcessLimits) -> tuple[int, str]:
    """Wait for a child; return its exit code, and a message if it did not end by itself."""
    try:
        code = child.wait(timeout=limits.seconds)
    except subprocess.TimeoutExpired:
        _kill(child)
        return 0, f"the reader took more than {limits.seconds:g} s"
    except KeyboardInterrupt:
        child.send_signal(signal.SIGINT)
        try:
            child.wait(timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired:
            _kill(child)
        raise
    if code >= 0:
        return code, ""
    with suppress(ValueError):
        return code, f"the reader ended by signal {-code} ({signal.Signals(-code).name})"
    return code, f"the reader ended by signal {-code}"


def _kill(child: subprocess.Popen[bytes]) -> None:
    """End a child and what it started."""
    with suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()


def _parts(folders: Sequence[Path]) -> set[Path]:
    """Return the files in folders that are being written."""
    return {path for folder in folders for path in folder.rglob(_PARTS) if path.is_file()}
