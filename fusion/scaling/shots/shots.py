"""Single shots: measured range against the range predicted from the SPC surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from fusion.scaling.fit.observation import ScaleObservations, TrajectorySource
from fusion.scaling.geometry.placement import LidarPlacement
from fusion.scaling.shots.spots import SpotOptions, Spots, cast_spots
from lidar.scans import Scan
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.navigation import iso_utc
from spcola.shape import RayCaster

# More oblique hits are excluded, as their ranges depend strongly on the slope.
_MIN_COSINE = 0.1


@dataclass(frozen=True, eq=False)
class ShotComparison:
    """Shots compared with a shape.

    Attributes
    ----------
    observations : ScaleObservations
        Of the shots whose beam hits the shape.
    hits : (N,) ndarray
        Mask of the shots whose beam hits the shape and does not graze it.
    """

    observations: ScaleObservations
    hits: BoolArray

    @property
    def missed(self) -> int:
        """Number of shots whose predicted beam misses the shape or grazes it."""
        return int(np.count_nonzero(~self.hits))


def compare_shots(
    scan: Scan,
    caster: RayCaster,
    *,
    trajectory: TrajectorySource = "reference",
    shares: FloatArray | None = None,
    spots: SpotOptions | None = None,
    known: LidarPlacement | None = None,
) -> ShotComparison:
    """Predict the range of each shot by casting its beam on the shape.

    The measured range is the distance from the spacecraft to the point, so that it refers to the
    spacecraft's position whatever the instrument's own reference point is.

    Parameters
    ----------
    scan : Scan
        With spacecraft positions and beams, in the frame of the shape.
    caster : RayCaster
        Of the SPC surface.
    trajectory : {"spc", "reference"}
        Source of the spacecraft positions; see :class:`ScaleObservations`.
    shares : (N, S) ndarray, optional
        Shares of S image states in the positions of the shots; by default the scan has one error.
    spots : SpotOptions, optional
        Footprint and pointing; by default neither is known.
    known : LidarPlacement, optional
        Assumed placement of the lidar surface, which is corrected before beams are cast; the point
        at which values are linearised. By default zero offset and rotation.

    Returns
    -------
    ShotComparison
        Without the shots whose spacecraft position or beam is unknown, that miss, or that graze;
        it may be empty.
    """
    beam = scan.beam
    measured = np.linalg.norm(scan.points - scan.spacecraft, axis=1)
    spots, place = spots or SpotOptions(), known or LidarPlacement()
    arm = measured[:, None] * beam if trajectory == "spc" else scan.points
    found = _predicted(scan, caster, spots, place.displaced(arm))
    distance, normal = found.distance, found.normal
    with np.errstate(invalid="ignore"):
        good = np.isfinite(distance) & (-np.sum(normal * beam, axis=1) > _MIN_COSINE)
    sigma = np.where(np.isfinite(scan.sigma), scan.sigma, spots.range_sigma_m)
    seen = Spots(distance, normal, sigma**2 + found.variance)
    patterns = np.ones((len(scan), 1)) if shares is None else shares
    return ShotComparison(_observations(scan, seen, good, patterns, trajectory), good)


def _observations(
    scan: Scan, seen: Spots, good: BoolArray, shares: FloatArray, trajectory: TrajectorySource
) -> ScaleObservations:
    """Return the good ones of the shots (N,) of a scan as observations."""
    count = int(good.sum())
    labels, beam = (scan.name,) * count, scan.beam[good]
    measured = np.linalg.norm(scan.points - scan.spacecraft, axis=1)[good]
    distance = seen.distance[good]
    return ScaleObservations(
        kind="shots",
        label=labels,
        day=_days(scan.time[good]),
        value=(measured - distance)[:, None],
        covariance=seen.variance[good][:, None, None],
        point=scan.spacecraft[good] + distance[:, None] * beam,
        beam=beam,
        range=distance,
        normal=seen.normal[good],
        local_time_h=np.full(count, np.nan),
        shares=shares[good],
        trajectory=trajectory,
        scan=labels,
    )


def _days(time: FloatArray) -> tuple[str, ...]:
    """Return the UTC date of each time (N,), ephemeris seconds; "unknown" for NaN."""
    if len(time) and np.isfinite(time).all():
        # Shots of a scan are nearly always of one day, and each conversion is a call to SPICE.
        first, last = (iso_utc(float(at), 0)[:10] for at in (time.min(), time.max()))
        if first == last:
            return (first,) * len(time)
    return tuple(iso_utc(at, 0)[:10] for at in time)


def _predicted(scan: Scan, caster: RayCaster, spots: SpotOptions, away: FloatArray) -> Spots:
    """Predict the ranges of shots on a surface displaced by `away` (N, 3), metres, from the shape.

    NaN for shots without a spacecraft position or a beam.
    """
    spacecraft, beam = scan.spacecraft, scan.beam
    placed = np.isfinite(spacecraft).all(axis=1) & np.isfinite(beam).all(axis=1)
    distance = np.full(len(scan), np.nan)
    normal = np.full((len(scan), 3), np.nan)
    variance = np.zeros(len(scan))
    if placed.any():
        found = cast_spots(caster, (spacecraft - away)[placed], beam[placed], spots)
        distance[placed], normal[placed] = found.distance, found.normal
        variance[placed] = found.variance
        distance -= np.sum(normal * away, axis=1) / np.sum(normal * beam, axis=1)
    return Spots(distance, normal, variance)


def join_shots(compared: Sequence[ShotComparison]) -> ShotComparison:
    """Join the comparisons `compared` of several scans.

    Raises
    ------
    InvalidValueError
        If there is nothing to join.
    """
    if not compared:
        raise InvalidValueError("there are no shots", "shots")
    parts = [one.observations for one in compared]
    labels = tuple(label for part in parts for label in part.label)
    # Image states are common to all scans; errors of whole scans are separate.
    shared = parts[0].trajectory == "spc"
    shares = [part.shares for part in parts]
    joint = np.concatenate(shares) if shared else block_diag(*shares)
    layers: dict[str, Any] = {
        layer: np.concatenate([getattr(part, layer) for part in parts])
        for layer in ("value", "covariance", "point", "beam", "range", "normal", "local_time_h")
    }
    days = tuple(day for part in parts for day in part.day)
    joined = replace(parts[0], label=labels, scan=labels, day=days, shares=joint, **layers)
    return ShotComparison(joined, np.concatenate([one.hits for one in compared]))
