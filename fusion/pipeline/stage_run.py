"""Outcome of one stage of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, Self

from fusion.estimation.verdict import Finding, Verdict

State = Literal["ran", "up to date", "cannot run"]


@dataclass(frozen=True)
class StageRun:
    """Outcome of one stage.

    Parameters
    ----------
    stage : str
    state : {"ran", "up to date", "cannot run"}
    seconds : float
        Time that it took.
    summary : mapping
        Summary of this run, or of the last one if the stage is up to date.
    reason : str
        Why it cannot run.
    obstacle : str
        Why its result may not be used, by its verdict; empty if it may.
    notes : tuple of str
        Files that were changed or damaged, and what was done about them.
    remarks : tuple of Finding
        Of the stage about this run only.
    """

    stage: str
    state: State
    seconds: float = 0.0
    summary: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""
    obstacle: str = ""
    notes: tuple[str, ...] = ()
    remarks: tuple[Finding, ...] = ()

    @classmethod
    def not_made(cls, stage: str, reason: str) -> Self:
        """Return the outcome of a stage that must not run, so that no other may use its result."""
        return cls(stage, "cannot run", reason=reason, obstacle=f"not made: {reason}")

    def as_json(self) -> dict[str, Any]:
        """Return the content of ``--json``."""
        content: dict[str, Any] = {"stage": self.stage, "state": self.state}
        content["seconds"] = self.seconds
        if self.reason:
            content["reason"] = self.reason
        if self.obstacle:
            content["obstacle"] = self.obstacle
        if self.notes:
            content["notes"] = list(self.notes)
        if self.remarks:
            content["remarks"] = [asdict(one) for one in self.remarks]
        return {**content, "summary": dict(self.summary)}

    def judged(self, accepted: Iterable[str], notes: tuple[str, ...]) -> Self:
        """Add why the result may not be used, unless its codes are accepted, and notes."""
        obstacle = Verdict.from_json(self.summary).obstacle(accepted)
        return replace(self, obstacle=obstacle, notes=notes)
