"""What the report shows; every part may be missing, and is then said to be missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fusion.estimation.verdict import Verdict
from fusion.fusing.maplets import FusedMaplet
from fusion.truth import Recovered
from spcola.arrays import FloatArray, check_shape, frozen


@dataclass(frozen=True, eq=False)
class Surfaces:
    """One place as images, lidar and both see it, on the grid of the fused maplet.

    Parameters
    ----------
    fused : FusedMaplet
    spc : (2q+1, 2q+1) array_like
        Heights of the SPC surface on the same grid, metres; NaN where unknown.
    lidar : (2q+1, 2q+1) array_like
        Heights of the registered mapola, metres; NaN where no return fell.
    why : str
        Why this place is shown.
    """

    fused: FusedMaplet
    spc: FloatArray
    lidar: FloatArray
    why: str = ""

    def __post_init__(self) -> None:
        for name in ("spc", "lidar"):
            layer = frozen(getattr(self, name), self.fused.grid.shape, name)
            object.__setattr__(self, name, layer)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Where maplets lie and how much of each the lidar covers.

    Parameters
    ----------
    centers : (N, 3) ndarray
        V of each, body-fixed, metres.
    share : (N,) ndarray
        Share of the grid points with a lidar height, 0 … 1; NaN: no mapola.
    """

    centers: FloatArray
    share: FloatArray

    def __post_init__(self) -> None:
        check_shape(self.centers, (None, 3), "centers")
        check_shape(self.share, (len(self.centers),), "share")


@dataclass(frozen=True, eq=False)
class ReportData:
    """All that a report is made of.

    Parameters
    ----------
    body : str
    surfaces : tuple of Surfaces
    coverage : Coverage, optional
    registration, scale : mapping, optional
        Contents of ``registration.json`` and ``scale.json``.
    planted : tuple of Recovered
        In the demo: what was planted, and what was found of it.
    versions : mapping of str to str
    verdicts : mapping of str to Verdict
        By stage, in the order of the data's walk.
    accepted : tuple of str
        Codes of findings that somebody accepted.
    """

    body: str = "body"
    surfaces: tuple[Surfaces, ...] = ()
    coverage: Coverage | None = None
    registration: Mapping[str, Any] | None = None
    scale: Mapping[str, Any] | None = None
    planted: tuple[Recovered, ...] = ()
    versions: Mapping[str, str] | None = None
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    accepted: tuple[str, ...] = ()
