"""What a power cut leaves: a simulation of the file operations that strace recorded."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

CALLS = "write,pwrite64,ftruncate,openat,mkdir,rename,renameat,renameat2,unlink,fsync,fdatasync"
_LINE = re.compile(r"(?P<process>\d+) +(?:<\.\.\. )?(?P<call>\w+)(?P<rest>.*)")
_OPENED = re.compile(r"\((\d+)<(/[^>]*)>")
_NAMES = re.compile(r'"(/[^"]*)"')


@dataclass
class Disk:
    """What is not on the disk yet: contents of files, and entries of folders.

    POSIX promises no more than this: `fsync` of a file writes its content, and `fsync` of a folder
    its entries.
    """

    contents: set[Path] = field(default_factory=set)
    entries: set[Path] = field(default_factory=set)
    torn: list[str] = field(default_factory=list)

    def do(self, call: str, rest: str) -> None:
        """Follow one operation."""
        opened, names = _OPENED.search(rest), [Path(name) for name in _NAMES.findall(rest)]
        if opened and call != "openat":
            path = Path(opened[2])
            if call in ("fsync", "fdatasync"):
                self.contents.discard(path)
                self.entries = {one for one in self.entries if one.parent != path}
            else:
                self.contents.add(path)
        elif call.startswith("rename") and len(names) == 2:
            self._rename(*names)
        elif call == "unlink" and names:
            self.contents.discard(names[0])
            self.entries.discard(names[0])
        elif names and (call == "mkdir" or "O_CREAT" in rest):
            self.entries.add(names[0])

    def _rename(self, old: Path, new: Path) -> None:
        if old in self.contents:
            self.torn.append(f"{new} got its name before its content was on the disk")
            self.contents.remove(old)
            self.contents.add(new)
        self.entries.discard(old)
        self.entries.add(new)

    def missing(self, roots: Iterable[Path]) -> list[str]:
        """Return what of some folders a power cut would take now, of what is there at the end."""
        lost = [("content", path) for path in self.contents]
        lost += [("name", path) for path in self.entries]
        return sorted(
            f"the {what} of {path}"
            for what, path in lost
            if path.exists() and any(root in path.parents for root in roots)
        )


def operations(trace: Path) -> Iterator[tuple[str, str]]:
    """Yield the calls of all threads and what was given to them, in the order of their ends.

    One that syncs counts where it begins: what is written meanwhile may be left out.
    """
    begun: dict[str, str] = {}
    for line in trace.read_text(errors="replace").splitlines():
        found = _LINE.match(line)
        if not found:
            continue
        process, call, rest = found["process"], found["call"], found["rest"]
        if rest.endswith("<unfinished ...>"):
            begun[process] = rest
            if call in ("fsync", "fdatasync"):
                yield call, rest
        elif "resumed>" in rest:
            if call not in ("fsync", "fdatasync"):
                yield call, begun.pop(process, "") + rest
        elif " = -1 " not in rest[-60:]:
            yield call, rest
