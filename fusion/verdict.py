"""Whether a result may be used: accepted, doubtful or refused, with a code for every reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Literal, Self

Judgement = Literal["accepted", "doubtful", "refused"]


class Severity(StrEnum):
    """What a finding does to the result: nothing, ask for a person's word, or end its use."""

    NOTE = "note"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


class Code(StrEnum):
    """Codes of findings, as other programs read them; :data:`MEANINGS` has a text for each."""

    CHANGED_INPUT = "changed-input"
    UNSOUND_MAPLET = "unsound-maplet"
    REJECTED_MAPLET = "rejected-maplet"


MEANINGS: Mapping[Code, str] = {
    Code.CHANGED_INPUT: "a file differs from what the stage that wrote it recorded",
    Code.UNSOUND_MAPLET: "a maplet contradicts its landmark, the shape or the other maplets",
    Code.REJECTED_MAPLET: "the registration did not use a maplet that is used here",
}
"""What each code means, for people."""


@dataclass(frozen=True)
class Finding:
    """One thing that was found about a result.

    Parameters
    ----------
    code : Code
    severity : Severity
    text : str
        What was found, with its numbers and their units: one clause.
    value, limit : float, optional
        The number that was tested and what it was tested against, in the unit of `text`.
    """

    code: Code
    severity: Severity
    text: str
    value: float | None = None
    limit: float | None = None


@dataclass(frozen=True)
class Verdict:
    """All that was found about a result, and what follows for its use.

    Parameters
    ----------
    findings : tuple of Finding
    """

    findings: tuple[Finding, ...] = ()

    @property
    def judgement(self) -> Judgement:
        """The worst of the findings decides."""
        found = {finding.severity for finding in self.findings}
        if Severity.REFUSED in found:
            return "refused"
        return "doubtful" if Severity.DOUBTFUL in found else "accepted"

    def obstacle(self, accepted: Iterable[str]) -> str:
        """Return why the result may not be used, with what to do; empty if it may.

        A doubtful result may be used once each of its codes is among those `accepted`; a refused
        one never.
        """
        refused = [found for found in self.findings if found.severity is Severity.REFUSED]
        if refused:
            return f"refused: {_listed(refused)}"
        named = set(accepted)
        doubtful = [
            found
            for found in self.findings
            if found.severity is Severity.DOUBTFUL and found.code not in named
        ]
        if not doubtful:
            return ""
        codes = " ".join(f"--accept {code}" for code in sorted({found.code for found in doubtful}))
        return f"doubtful: {_listed(doubtful)}; look at it, and go on with {codes}"

    def as_json(self) -> dict[str, Any]:
        """Return ``verdict`` and ``findings`` in JSON types."""
        return {
            "verdict": self.judgement,
            "findings": [asdict(finding) for finding in self.findings],
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Rebuild from what :meth:`as_json` gave; a result without ``findings`` has none.

        Raises
        ------
        ValueError, KeyError
            If a finding is not understood: it is not passed over.
        """
        return cls(tuple(_finding(entry) for entry in content.get("findings") or ()))


def _finding(entry: Mapping[str, Any]) -> Finding:
    return Finding(
        Code(entry["code"]),
        Severity(entry["severity"]),
        str(entry["text"]),
        entry.get("value"),
        entry.get("limit"),
    )


def _listed(findings: Sequence[Finding]) -> str:
    return "; ".join(f"{finding.text} [{finding.code}]" for finding in findings)


def verdict_lines(content: Mapping[str, Any]) -> list[str]:
    """Return what people read first of a result that has a verdict; nothing if it has none."""
    if "verdict" not in content:
        return []
    verdict = Verdict.from_json(content)
    return [
        f"verdict: {verdict.judgement}",
        *(f"  {found.severity}: {found.text} [{found.code}]" for found in verdict.findings),
    ]
