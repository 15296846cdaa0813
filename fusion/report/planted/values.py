"""What a synthetic mission planted, against what was recovered of it; the file with both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any, TypeVar

from fusion.workspace import Workspace
from spcola.errors import FormatError

PLANTED_FILE = "planted.json"
"""File in which a demo writes what it planted: a list under ``planted``, each entry with the
keys of :class:`RecoveredParameter`, and one under ``errors`` with those of
:class:`SurfaceErrors`; null for NaN."""


@dataclass(frozen=True)
class RecoveredParameter:
    """One planted parameter and its estimate.

    Attributes
    ----------
    name : str
    planted, recovered, sigma : float
        In `unit`; NaN where it was not estimated.
    unit : str
        Empty if dimensionless.
    explanation : str
        Of a large pull: see :func:`fusion.truth.causes.explained`.
    """

    name: str
    planted: float
    recovered: float
    sigma: float
    unit: str
    explanation: str = ""

    @property
    def pull(self) -> float:
        """(recovered − planted) / sigma; NaN without a sigma."""
        if not self.sigma > 0:
            return float("nan")
        return (self.recovered - self.planted) / self.sigma


@dataclass(frozen=True)
class SurfaceErrors:
    """Errors of the heights of one surface.

    Attributes
    ----------
    name : str
        Of the surface.
    share : float
        Of all grid points, those of which it has a height, 0 … 1.
    within_68_m, within_95_m : float
        68 % and 95 % of its errors are smaller than this, metres; NaN without any height.
    rms_m : float
        Root mean square of its errors, metres.
    """

    name: str
    share: float
    within_68_m: float
    within_95_m: float
    rms_m: float


Row = TypeVar("Row", RecoveredParameter, SurfaceErrors)


def write_planted(
    workspace: Workspace, parameters: Sequence[RecoveredParameter], errors: Sequence[SurfaceErrors]
) -> None:
    """Write :data:`PLANTED_FILE` into a workspace, for its report."""
    rows = {
        "planted": [asdict(row) for row in parameters],
        "errors": [asdict(row) for row in errors],
    }
    workspace.write_json(PLANTED_FILE, rows)


def read_planted(
    workspace: Workspace,
) -> tuple[tuple[RecoveredParameter, ...], tuple[SurfaceErrors, ...]]:
    """Read :data:`PLANTED_FILE` of a workspace; both are empty if there is none.

    Raises
    ------
    FormatError
        If an entry is missing or damaged.
    WorkspaceError
        If it is not JSON.
    """
    content = workspace.find_json(PLANTED_FILE) or {}
    try:
        return (
            tuple(_row(entry, RecoveredParameter) for entry in content.get("planted", ())),
            tuple(_row(entry, SurfaceErrors) for entry in content.get("errors", ())),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FormatError(f"does not state what was planted ({error})", PLANTED_FILE) from error


def _row(entry: Mapping[str, Any], kind: type[Row]) -> Row:
    """Read one row: texts as they are, numbers and null as numbers."""
    values: dict[str, Any] = {
        field.name: entry[field.name] if field.default is MISSING else entry.get(field.name, "")
        for field in fields(kind)
    }
    for name, value in values.items():
        if not isinstance(value, str):
            values[name] = float("nan" if value is None else value)
    return kind(**values)
