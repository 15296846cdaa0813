"""Text kernels: their assignments, and the lists of meta-kernels."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from spcola.errors import KernelError

# A text kernel is data between \begindata and \begintext; the rest is comment.
_DATA = re.compile(
    r"^[ \t]*\\begindata[ \t]*\r?$(.*?)(?:^[ \t]*\\begintext[ \t]*\r?$|\Z)", re.M | re.S
)
# Without backtracking, and tried only at the begin of a word: the time is linear in the length.
_ASSIGNMENT = re.compile(
    r"(?<![A-Za-z0-9_/-])([A-Za-z0-9_/-]++)\s*+(\+?=)\s*+(\([^()]*+\)|'[^']*+'|\S++)", re.S
)
# SPICE loads 5300 kernels at once.
_MOST_KERNELS = 5300
_LONGEST_PATH = 4096
_STRING = re.compile(r"'((?:[^']|'')*)'")


def expand_meta_kernels(paths: list[Path], *, within: tuple[Path, ...] = ()) -> list[Path]:
    """Return the kernels at `paths`, every meta-kernel replaced by its list, in loading order.

    Paths inside a meta-kernel are taken from its own folder first, so that it can be used from
    anywhere, then from the current one as SPICE does. `within` are the meta-kernels that list them.


    Raises
    ------
    KernelError
        If a kernel is missing or cannot be read, or a meta-kernel lists none, or itself.
    """
    expanded: list[Path] = []
    for path in paths:
        if not _is_file(path):
            raise KernelError("is not a file", path, "check the list of kernels")
        if any(path.samefile(outer) for outer in within):
            raise KernelError("lists itself", path, "take it off its own list of kernels")
        listed = kernels_of(path) if is_text(path) else None
        expanded.extend(
            [path] if listed is None else expand_meta_kernels(listed, within=(*within, path))
        )
        if len(expanded) > _MOST_KERNELS:
            raise KernelError(
                f"lists over {_MOST_KERNELS} kernels, more than SPICE loads", path, "correct it"
            )
    return expanded


def kernels_of(path: Path) -> list[Path] | None:
    """Return the kernels that a meta-kernel lists; None if `path` is another text kernel.

    Raises
    ------
    KernelError
        If its path symbols and values do not pair, or the list is empty.
    """
    values: dict[str, list[str]] = {}
    for name, _, text in assignments(path):
        strings = [item.replace("''", "'") for item in _STRING.findall(text)]
        values.setdefault(name.upper(), []).extend(strings)
    if "KERNELS_TO_LOAD" not in values:
        return None
    symbols, folders = values.get("PATH_SYMBOLS", []), values.get("PATH_VALUES", [])
    if len(symbols) != len(folders):
        raise KernelError(
            f"{len(symbols)} PATH_SYMBOLS for {len(folders)} PATH_VALUES", path, "correct it"
        )
    names = list(_joined(values["KERNELS_TO_LOAD"]))
    if not names:
        raise KernelError("KERNELS_TO_LOAD is empty", path, "list the kernels")
    for symbol, folder in zip(symbols, folders, strict=True):
        names = [name.replace(f"${symbol}", folder) for name in names]
        if max(map(len, names)) > _LONGEST_PATH:
            raise KernelError("KERNELS_TO_LOAD holds a name that is no path", path, "correct it")
    local = [path.parent / name for name in names]
    return [b if _is_file(b) else Path(n) for b, n in zip(local, names, strict=True)]


def assignments(path: Path) -> Iterator[tuple[str, str, str]]:
    """Yield names, operators (``=`` or ``+=``) and right-hand sides of a text kernel, in order."""
    try:
        text = path.read_text(encoding="latin-1")
    except OSError as error:
        raise KernelError(f"cannot be read ({error.strerror})", path, "check the file") from error
    for block in _DATA.findall(text):
        yield from _ASSIGNMENT.findall(block)


def _is_file(path: Path) -> bool:
    """Return whether there is such a file; False for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_text(path: Path) -> bool:
    """Return whether a file is a text kernel: neither binary nor transfer text."""
    with path.open("rb") as stream:
        head = stream.read(512)
    return b"\0" not in head and not head.startswith((b"DAF", b"DAS", b"NAIF/DA"))


def _joined(parts: list[str]) -> Iterator[str]:
    """Join strings that end in ``+`` with the next one, as long file names are written."""
    pending = ""
    for part in parts:
        if part.rstrip().endswith("+"):
            pending += part.rstrip()[:-1]
        else:
            yield pending + part
            pending = ""
