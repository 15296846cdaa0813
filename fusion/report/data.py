"""Content of the report; every part may be missing, which the report then states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fusion.estimation.verdict import Verdict
from fusion.fusing.maplets import FusedMaplet
from fusion.report.photoclinometry import SolvedMaplets
from fusion.report.planted import RecoveredParameter, SurfaceErrors
from spcola.arrays import AnyArray, FloatArray, check_shape, frozen


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Heights of SPC, lidar and both fused at one place, on the grid of the fused maplet.

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
class LidarCoverage:
    """Places of maplets, and the share of each that the lidar covers.

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
class Origins:
    """What the fused heights rest on, all over the body.

    Parameters
    ----------
    directions : (N, 3) ndarray
        Of points of fused maplets, body-fixed; of any length.
    source : (N,) integer ndarray
        One :class:`fusion.fusing.maplets.Source` for each point.
    """

    directions: FloatArray
    source: AnyArray

    def __post_init__(self) -> None:
        check_shape(self.directions, (None, 3), "directions")
        check_shape(self.source, (len(self.directions),), "source")


@dataclass(frozen=True, eq=False)
class ReportData:
    """All content of a report.

    Parameters
    ----------
    body : str
    surfaces : tuple of Surfaces
    coverage : LidarCoverage, optional
    registration, scale : mapping, optional
        Contents of ``registration.json`` and ``scale.json``.
    planted : tuple of RecoveredParameter
        In the demo: planted and recovered parameters.
    versions : mapping of str to str
    verdicts : mapping of str to Verdict
        By stage, in the order of the processing.
    accepted : tuple of str
        Codes of findings that the user accepted.
    origins : Origins, optional
    errors : tuple of SurfaceErrors
        In the demo: how far each surface is from the true one.
    solved : SolvedMaplets, optional
        Maplets solved from images.
    """

    body: str = "body"
    surfaces: tuple[Surfaces, ...] = ()
    coverage: LidarCoverage | None = None
    registration: Mapping[str, Any] | None = None
    scale: Mapping[str, Any] | None = None
    planted: tuple[RecoveredParameter, ...] = ()
    versions: Mapping[str, str] | None = None
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    accepted: tuple[str, ...] = ()
    origins: Origins | None = None
    errors: tuple[SurfaceErrors, ...] = ()
    solved: SolvedMaplets | None = None
