"""Returns located again with another trajectory: SPC states for reference ones (MATH §9)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lidar.geolocation.placement import NO_TIME, OUTSIDE, counted
from lidar.scans import Scan
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.navigation import Trajectory

MAX_GAP_S = 3600.0
"""Default for the longest time between two states over which their offset is interpolated."""


@dataclass(frozen=True, eq=False)
class Reprojection:
    """A scan located again; M of its N returns remain.

    Parameters
    ----------
    scan : Scan
        With the new points, spacecraft positions and trajectory name; `scan.rejected` counts
        those left out.
    kept : (N,) ndarray
        Which returns of the old scan are in it.
    offset : (M, 3) ndarray
        What was added to each point, body-fixed, metres.
    sigma : (M, 3) ndarray
        One standard deviation of the offset along the body-fixed axes, metres: of the states
        and of the interpolation between them; NaN if not known.
    """

    scan: Scan
    kept: BoolArray
    offset: FloatArray
    sigma: FloatArray


def reproject(
    scan: Scan,
    trajectory: Trajectory,
    *,
    reference: Trajectory | None = None,
    range_offset: float | None = None,
    max_gap_s: float = MAX_GAP_S,
) -> Scan:
    """Return `scan` located with `trajectory`; see `relocate`, which says more of the result."""
    return relocate(
        scan, trajectory, reference=reference, range_offset=range_offset, max_gap_s=max_gap_s
    ).scan


def relocate(
    scan: Scan,
    trajectory: Trajectory,
    *,
    reference: Trajectory | None = None,
    range_offset: float | None = None,
    max_gap_s: float = MAX_GAP_S,
) -> Reprojection:
    """Locate the returns of a scan with another trajectory.

    The *difference* of the trajectories is interpolated to the time of each return, in straight
    lines: it is smooth where the positions themselves turn with the body, so that a trajectory
    known at image times only serves the returns between them. Pointing stays as it was.

    Parameters
    ----------
    scan : Scan
        With times and the spacecraft positions by which it was located.
    trajectory : Trajectory
        The new one, in the same body-fixed frame.
    reference : Trajectory, optional
        The old one. By default the scan's own spacecraft positions, which serve if the new
        trajectory has times within the scan.
    range_offset : float, optional
        Distance from the spacecraft to the range's reference point, metres: returns are put at
        ``spacecraft + beam · (range + range_offset)``. By default each return keeps the offset
        that it came with (`Scan.reference_offset`), so that points move as the spacecraft does.
    max_gap_s : float
        Returns between two times further apart than this, seconds, are rejected and counted,
        as are those outside the trajectory.

    Raises
    ------
    InvalidValueError
        If the two trajectories have no time in common, or the scan has no position at a time.
    """
    old = scan_trajectory(scan) if reference is None else reference
    offsets = trajectory.offset_from(old, max_gap_s=max_gap_s)
    offset, sigma = offsets.at(scan.time, max_gap_s=max_gap_s)
    kept: BoolArray = np.all(np.isfinite(offset), axis=1)
    timeless = int(np.sum(np.isnan(scan.time)))
    rejected = counted(scan.rejected, {NO_TIME: timeless, OUTSIDE: int(np.sum(~kept)) - timeless})
    chosen = replace(scan.select(kept), rejected=rejected, trajectory=trajectory.name)
    spacecraft = chosen.spacecraft + offset[kept]
    points = chosen.points + offset[kept]
    if range_offset is not None:
        points = spacecraft + chosen.beam * (chosen.range + range_offset)[:, None]
    moved = chosen.with_points(points, spacecraft=spacecraft)
    return Reprojection(moved, kept, offset[kept], sigma[kept])


def scan_trajectory(scan: Scan) -> Trajectory:
    """Return the spacecraft positions of a scan as a trajectory , its times sorted and single.

    Raises
    ------
    InvalidValueError
        If no return has both a time and a spacecraft position.
    """
    known = np.isfinite(scan.time) & np.isfinite(scan.spacecraft).all(axis=1)
    if not known.any():
        raise InvalidValueError(
            "has no time with a spacecraft position", scan.name, "give a reference trajectory"
        )
    time, first = np.unique(scan.time[known], return_index=True)
    return Trajectory(scan.trajectory, time, scan.spacecraft[known][first])
