"""Cache of compiled kernels, with a fallback where it cannot be written.

Numba stores them next to the source or in the user's cache folder. Where neither can be written (a
container's read-only image, a user without a home) it gives up; here a private folder among the
temporary files replaces them, and where that fails too, or the disk is full, each process compiles
the kernels. This costs time and never changes a result.
"""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar

import numba
from numba.core.caching import FunctionCache
from numba.core.sigutils import normalize_signature

_VARIABLE = "NUMBA_CACHE_DIR"
_ADVICE = f"set {_VARIABLE} to a folder that can be written"


class KernelCache(FunctionCache):  # type: ignore[misc]  # Numba has no types
    """Stores Numba's code of one function, as long as it can be written.

    Attributes
    ----------
    usable : bool
        Whether any can be written; shared by all functions of the process.
    """

    usable: ClassVar[bool] = True

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the stored code; None, so that it is compiled, where that cannot be read."""
        try:
            found = super().load_overload(sig, target_context)
        # A file cut short by a full disk fails in as many ways as pickle knows.
        except Exception:
            self._forget()
            return None
        # Two processes that keep a kernel of other types at the same moment may choose one file.
        if found is not None and tuple(found.signature.args) != tuple(normalize_signature(sig)[0]):
            self._forget()
            return None
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled code, unless an earlier attempt failed."""
        if not KernelCache.usable:
            return
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self._forget()
            _give_up(f"in {self.cache_path} ({error.strerror})")

    def _forget(self) -> None:
        """Remove the index, which without its data could refer to those of older source."""
        with suppress(OSError):
            Path(self._cache_file._index_path).unlink(missing_ok=True)


def keep_compiled(kernel: Any, function: Callable[..., Any]) -> None:
    """Let Numba's `kernel` of `function` load and store its compiled code, where possible."""
    if not KernelCache.usable:
        return
    # Same as numba.njit(cache=True), with a cache that may fail.
    try:
        kernel._cache = KernelCache(function)
    except RuntimeError:
        folder = _temporary_folder()
        if folder is None:
            _give_up("next to the program, in the home folder or among temporary files")
            return
        # Child processes need not search again; Numba reads the variable again.
        os.environ[_VARIABLE] = numba.config.CACHE_DIR = str(folder)
        kernel._cache = KernelCache(function)
        _note(f"{folder} keeps compiled kernels: program and home folder cannot be written")


def is_kept(kernel: Any) -> bool:
    """Return whether a compiled form of Numba's `kernel` is kept, of its source as it is now."""
    cache = kernel._cache
    try:
        return isinstance(cache, KernelCache) and bool(cache._cache_file._load_index())
    # As when it is loaded: it is compiled anew then.
    except Exception:
        return False


def _temporary_folder() -> Path | None:
    """Return a folder among temporary files that only this user can write; None if impossible.

    Compiled code is run when it is loaded: a folder that another user made, or could write to, is
    not used.
    """
    try:
        folder = Path(tempfile.gettempdir()) / f"spcola-kernels-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return None
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
    return folder if private and found.st_uid == os.getuid() else None


def _give_up(where: str) -> None:
    KernelCache.usable = False
    _note(f"compiled kernels cannot be kept {where}: every process compiles them; {_ADVICE}")


def _note(text: str) -> None:
    """Print one line on standard error."""
    print(f"note: {text}", file=sys.stderr, flush=True)  # noqa: T201
