"""Prior sizes of the errors of scans, and displacements of scans from their stated places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidar.adjustment.arcs import RigidArcs, ScanErrorSizes
from lidar.adjustment.overlaps import COMPONENTS
from lidar.scans import Returns
from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled
from spcola.errors import SettingsError

# A scan whose misfit exceeds the median by this factor does not fit at any displacement.
_SUSPECT = 3.0


@dataclass(frozen=True)
class AdjustmentOptions:
    """Prior sizes of the errors of scans.

    Parameters
    ----------
    offset_sigma_m : float
        First value of the standard deviation of a scan's displacement, each axis, metres.
    rotation_sigma_rad : float
        The same of its rotation, radians.
    wander_sigma_m : float
        The same of its additional displacement on one grid, metres.
    day_sigma_m : float
        The same of the common displacement of all scans of a day along the radius, metres.
    estimate : bool
        Whether all are estimated from the overlaps, or kept.

    Raises
    ------
    SettingsError
        If a number is not positive.
    """

    offset_sigma_m: float = 0.05
    rotation_sigma_rad: float = 5e-5
    wander_sigma_m: float = 5e-4
    day_sigma_m: float = 0.02
    estimate: bool = True

    def __post_init__(self) -> None:
        for name in ("offset_sigma_m", "rotation_sigma_rad", "wander_sigma_m", "day_sigma_m"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"must be positive, not {getattr(self, name)}", name)

    @property
    def sizes(self) -> ScanErrorSizes:
        """First values of the sizes of the errors."""
        offset = self.offset_sigma_m
        return ScanErrorSizes(
            offset, offset, self.rotation_sigma_rad, self.wander_sigma_m, self.day_sigma_m
        )


@dataclass(frozen=True, eq=False)
class ScanAdjustment:
    """Displacements of S scans from their stated places.

    Attributes
    ----------
    names : tuple of str
    arcs : RigidArcs
        The points about which they are rotated, and the scan of each.
    displacement : (S, 6) ndarray
        Stated minus adjusted place of the centre (metres), and the rotation vector from adjusted
        to stated orientation (radians).
    covariance : (6S, 6S) ndarray
        Covariance of the remaining displacements.
    sizes : ScanErrorSizes
        Sizes of the displacements.
    misfit : (S,) ndarray
        Root mean square of the remaining differences between a scan and the others, in standard
        deviations; NaN for a scan without overlaps, or with too few cells.
    cells : (S,) ndarray
        Cells in which it meets others.
    step_m : float
        Change of the height differences between scans in the last round (rms over their
        overlaps); NaN before any round, 0 without overlaps.
    """

    names: tuple[str, ...]
    arcs: RigidArcs
    displacement: FloatArray
    covariance: FloatArray
    sizes: ScanErrorSizes
    misfit: FloatArray
    cells: FloatArray
    step_m: float = float("nan")

    @classmethod
    def unadjusted(
        cls, names: Sequence[str], arcs: RigidArcs, options: AdjustmentOptions
    ) -> ScanAdjustment:
        """Return the prior by `options` of the scans `names`, one for each of `arcs`."""
        count = len(names)
        return cls(
            tuple(names),
            arcs,
            np.zeros((count, COMPONENTS)),
            arcs.prior(options.sizes),
            options.sizes,
            np.full(count, np.nan),
            np.zeros(count),
        )

    def __len__(self) -> int:
        return len(self.names)

    @property
    def center(self) -> FloatArray:
        """Body-fixed points (S, 3) about which they are rotated, metres."""
        return self.arcs.center

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations (S, 6) of the remaining displacements: metres and radians."""
        return np.sqrt(np.diag(self.covariance)).reshape(-1, COMPONENTS)

    @property
    def suspects(self) -> tuple[str, ...]:
        """Scans that do not fit the others at any displacement."""
        known = np.isfinite(self.misfit)
        if not known.any():
            return ()
        limit = _SUSPECT * max(float(np.median(self.misfit[known])), 1.0)
        return tuple(self.names[k] for k in np.flatnonzero(known & (self.misfit > limit)))

    def corrected(self, returns: Returns) -> Returns:
        """Return `returns` with displacements removed; those of other scans are unchanged."""
        own = {name: number for number, name in enumerate(self.names)}
        which = np.array([own.get(name, len(self)) for name in returns.scan_names], dtype=np.intp)
        center = np.vstack([self.center, np.zeros(3)])[which]
        displacement = np.vstack([self.displacement, np.zeros(COMPONENTS)])[which]
        points = _without_displacement(returns.points, returns.scan, center, displacement)
        return Returns(points, returns.sigma, returns.scan, returns.scan_names)

    def reach(self, center: FloatArray, radius: float) -> float:
        """Return the largest displacement of points within `radius` of `center` (3,), metres."""
        arm = np.linalg.norm(self.center - center, axis=1) + radius
        shift, turn = (np.linalg.norm(self.displacement[:, k : k + 3], axis=1) for k in (0, 3))
        return float((shift + turn * arm).max(initial=0.0))


@compiled
def _without_displacement(
    points: FloatArray, scan: IntArray, center: FloatArray, displacement: FloatArray
) -> FloatArray:
    """Return points (N, 3) less the displacement of their scans, metres.

    To first order in the angles, which are some 1e-4.
    """
    moved = np.empty(points.shape)
    for n in range(len(points)):
        s = scan[n]
        d = displacement[s]
        x, y, z = (
            points[n, 0] - center[s, 0],
            points[n, 1] - center[s, 1],
            points[n, 2] - center[s, 2],
        )
        moved[n, 0] = points[n, 0] - (d[0] + d[4] * z - d[5] * y)
        moved[n, 1] = points[n, 1] - (d[1] + d[5] * x - d[3] * z)
        moved[n, 2] = points[n, 2] - (d[2] + d[3] * y - d[4] * x)
    return moved
