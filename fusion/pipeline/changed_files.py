"""Results of a stage that were changed, removed or added since the stage wrote them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fusion.estimation.verdict import Code, Finding, Severity
from fusion.runtime.findings import first_names

# So many files are named; the others are counted.
_NAMED = 3


@dataclass(frozen=True)
class Changed:
    """Files that changed since a stage wrote them, by their names in the catalogue.

    Attributes
    ----------
    stage : str
    differing, gone, foreign : tuple of str
        With another content than recorded; missing; present but not recorded.
    unrecorded : tuple of str
        Present, but the stage has no record to compare them with.
    """

    stage: str
    differing: tuple[str, ...] = ()
    gone: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    unrecorded: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.is_contradicted or bool(self.unrecorded)

    @property
    def is_contradicted(self) -> bool:
        """Whether the files contradict the record of the stage."""
        return bool(self.differing or self.gone or self.foreign)

    @property
    def text(self) -> str:
        """What changed, in one clause."""
        parts = []
        if self.differing:
            parts.append(_changed_since(self.differing, f"{self.stage} wrote it"))
        if self.gone:
            verb = "is" if len(self.gone) == 1 else "are"
            parts.append(f"{_named(self.gone)}, which stage {self.stage} wrote, {verb} gone")
        if self.foreign:
            verb = "is" if len(self.foreign) == 1 else "are"
            parts.append(f"{_named(self.foreign)} {verb} not in the record of stage {self.stage}")
        if self.unrecorded:
            parts.append(
                f"stage {self.stage} has no record, so {_named(self.unrecorded)} cannot be checked"
            )
        return " and ".join(parts)

    def finding(self, severity: Severity) -> Finding:
        """Return a finding about results that depend on these files."""
        return Finding(Code.CHANGED_INPUT, severity, self.text)


def changed_since(names: Sequence[str], stage: str) -> str:
    """Return in one clause which inputs changed since `stage` last used them."""
    return _changed_since(names, f"{stage} last used it")


def _changed_since(names: Sequence[str], when: str) -> str:
    return f"{_named(names)} {'has' if len(names) == 1 else 'have'} changed since stage {when}"


def _named(names: Sequence[str]) -> str:
    return first_names(names, _NAMED)
