"""Screening: which records of a lidar file become returns, and why the others do not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lidar.formats.options import LidarOptions
from lidar.scan import Scan
from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.errors import FormatError

# 1950 to 2150: every altimeter that flew or will fly soon; a garbled time falls outside.
_EARLIEST_S, _LATEST_S = -1.6e9, 4.8e9
# Nothing that a lidar ranges to lies a light-minute from the body's centre.
_FARTHEST_M = 2e10


@dataclass(frozen=True, eq=False)
class Records:
    """Raw records of one chunk, N of them, in SI units; None: the file has no such quantity.

    Parameters
    ----------
    points, spacecraft : (N, 3) ndarray
        Body-fixed positions, metres.
    range : (N,) ndarray
        Measured range, metres.
    spherical : (N, 3) ndarray
        East longitude, latitude (rad) and radius (m) of the return, where the record states
        its position twice.
    time, intensity, flag, sigma : (N,) ndarray
        As in `Scan`.
    refused : mapping of str to (N,) bool ndarray
        What the format's own flags refuse, by reason; the first that holds is counted.
    unreadable : int
        Records so broken that they have no place in the arrays.
    """

    points: FloatArray
    spacecraft: FloatArray | None = None
    range: FloatArray | None = None
    spherical: FloatArray | None = None
    time: FloatArray | None = None
    intensity: FloatArray | None = None
    flag: AnyArray | None = None
    sigma: FloatArray | None = None
    refused: Mapping[str, BoolArray] = field(default_factory=dict)
    unreadable: int = 0


@dataclass(frozen=True)
class Agreement:
    """How far apart two statements of one quantity may be.

    Parameters
    ----------
    offset_m : float
        Distance from spacecraft to point less the range, as expected of the instrument.
    tolerance_m : float
        Largest departure from it, and largest distance between two statements of the position.
    """

    offset_m: float
    tolerance_m: float

    def adjusted(self, options: LidarOptions) -> Agreement:
        """Return the agreement with what `options` state in place of the format's own."""
        offset, tolerance = options.reference_offset_m, options.range_tolerance_m
        return Agreement(
            self.offset_m if offset is None else offset,
            self.tolerance_m if tolerance is None else tolerance,
        )


class Screen:
    """Turns the chunks of one file into scans, in order.

    Parameters
    ----------
    path : Path
        Named in errors, and the source of the scan's name.
    agreement : Agreement
        The format's own.
    options : LidarOptions
    """

    def __init__(self, path: Path, agreement: Agreement, options: LidarOptions) -> None:
        self._path = path
        self._options = options
        self._agreement = agreement.adjusted(options)
        self._units_known = False

    def scan(self, records: Records) -> Scan:
        """Return the accepted returns of a chunk, the others counted by reason.

        Raises
        ------
        FormatError
            If most of the first returns contradict themselves: a column in another unit, not
            a bad record here and there.
        """
        tally = _Tally(len(records.points))
        for reason, mask in records.refused.items():
            tally.refuse(mask, reason)
        distance = self._distance(records)
        measured = distance if records.range is None else records.range
        self._refuse_impossible(tally, records, measured)
        self._refuse_contradictions(tally, records, distance)
        self._refuse_radius(tally, records.points)
        counts = tally.counts
        if records.unreadable:
            counts["unreadable record"] = records.unreadable
        return self._scan(records, distance, measured, tally.kept, counts)

    @staticmethod
    def _distance(records: Records) -> FloatArray:
        """Distance from spacecraft to point (N,), metres; NaN without a spacecraft."""
        if records.spacecraft is None:
            return np.full(len(records.points), np.nan)
        return norms(records.points - records.spacecraft)

    def _refuse_impossible(self, tally: _Tally, records: Records, measured: FloatArray) -> None:
        """Refuse what no return can be: not a number, no range, no time."""
        finite: BoolArray = np.isfinite(norms(records.points))
        for stated in (records.range, records.time):
            if stated is not None:
                finite &= np.isfinite(stated)
        if records.spacecraft is not None:
            finite &= np.isfinite(records.spacecraft).all(axis=1)
        tally.refuse(np.logical_not(finite), "not finite")
        tally.refuse(measured <= 0, "no-echo sentinel")
        tally.refuse(norms(records.points) > _FARTHEST_M, "not plausible")
        if records.time is not None:
            outside = (records.time < _EARLIEST_S) | (records.time > _LATEST_S)
            tally.refuse(outside, "time not plausible")

    def _refuse_contradictions(self, tally: _Tally, records: Records, distance: FloatArray) -> None:
        """Refuse records whose range, or second statement of position, contradicts the point."""
        tested = tally.kept
        if records.range is not None and records.spacecraft is not None:
            excess = np.abs(distance - records.range - self._agreement.offset_m)
            tally.refuse(~(excess <= self._agreement.tolerance_m), "range and point disagree")
        if records.spherical is not None:
            apart = norms(records.points - cartesian(records.spherical))
            tally.refuse(~(apart <= self._agreement.tolerance_m), "coordinates disagree")
        if self._units_known or not tested.any():
            return
        self._check_units(tested, tally.kept, records)
        self._units_known = True

    def _check_units(self, tested: BoolArray, kept: BoolArray, records: Records) -> None:
        """Refuse the file if most of its first sound records contradict themselves."""
        wrong = tested & ~kept
        if 2 * wrong.sum() <= tested.sum():
            return
        sizes = [f"|point| {np.median(norms(records.points[wrong])):.6g} m"]
        if records.spherical is not None:
            sizes.append(f"radius {np.median(records.spherical[wrong, 2]):.6g} m")
        if records.range is not None and records.spacecraft is not None:
            sizes.append(f"|spacecraft| {np.median(norms(records.spacecraft[wrong])):.6g} m")
            sizes.append(f"range {np.median(records.range[wrong]):.6g} m")
        raise FormatError(
            f"{wrong.sum()} of the first {tested.sum()} returns contradict themselves "
            f"({', '.join(sizes)}), the first is record {1 + int(np.argmax(wrong))}",
            self._path,
            "check the units of its columns (km for m?), the body-fixed frame and the format; "
            "range_tolerance_m widens what is accepted",
        )

    def _refuse_radius(self, tally: _Tally, points: FloatArray) -> None:
        """Refuse returns off the body, and the file if it has hardly any other."""
        limits = self._options.radius_limits_m
        if limits is None:
            return
        radius = norms(points)
        tested = tally.kept
        tally.refuse(~((radius >= limits[0]) & (radius <= limits[1])), "outside the radius limits")
        if 2 * tally.kept.sum() < tested.sum():
            raise FormatError(
                f"most returns lie outside the radius limits {limits[0]:g} to {limits[1]:g} m "
                f"(median {np.median(radius[tested]):.6g} m)",
                self._path,
                "check the unit of its coordinates (km for m?)",
            )

    def _scan(
        self,
        records: Records,
        distance: FloatArray,
        measured: FloatArray,
        kept: BoolArray,
        counts: dict[str, int],
    ) -> Scan:
        options = self._options
        whole = bool(kept.all())
        count = len(kept)

        def layer(values: AnyArray | None, default: AnyArray) -> AnyArray:
            chosen = default if values is None else values
            return chosen if whole else chosen[kept]

        unknown = np.full(count, np.nan)
        points = layer(records.points, records.points)
        spacecraft = layer(records.spacecraft, np.full((count, 3), np.nan))
        # No accepted return has distance zero, for its range would not be positive.
        beam = (points - spacecraft) / layer(distance, unknown)[:, None]
        return Scan(
            name=options.name or self._path.stem,
            time=layer(records.time, unknown),
            range=layer(measured, unknown),
            spacecraft=spacecraft,
            beam=beam,
            points=points,
            intensity=layer(records.intensity, unknown),
            flag=layer(records.flag, np.zeros(count, dtype=np.int16)),
            sigma=layer(records.sigma, np.full(count, options.sigma_m)),
            trajectory=options.trajectory,
            body=options.body,
            rejected=counts,
        )


class _Tally:
    """Keeps for each of `count` records whether it is kept, and counts refusals by reason."""

    def __init__(self, count: int) -> None:
        self._kept = np.ones(count, dtype=bool)
        self.counts: dict[str, int] = {}

    @property
    def kept(self) -> BoolArray:
        """Mask (N,) of the records not refused so far."""
        return self._kept.copy()

    def refuse(self, mask: BoolArray, reason: str) -> None:
        """Refuse the records of `mask`; those refused before keep their earlier reason."""
        newly = mask & self._kept
        count = int(newly.sum())
        if count:
            self.counts[reason] = self.counts.get(reason, 0) + count
            self._kept &= ~newly


def norms(vectors: FloatArray) -> FloatArray:
    """Lengths (N,) of `vectors` (N, 3)."""
    # einsum makes no temporary the size of the vectors, unlike linalg.norm.
    lengths: FloatArray = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return lengths


def cartesian(spherical: FloatArray) -> FloatArray:
    """Body-fixed positions (N, 3), metres, of east longitude, latitude (rad), radius (m)."""
    longitude, latitude, radius = spherical.T
    level = radius * np.cos(latitude)
    x, y, z = level * np.cos(longitude), level * np.sin(longitude), radius * np.sin(latitude)
    return np.stack([x, y, z], axis=1)


def spherical_of(
    longitude_deg: FloatArray, latitude_deg: FloatArray, radius: FloatArray
) -> FloatArray:
    """East longitude, latitude (rad) and radius (m) as one array (N, 3), from degrees."""
    return np.stack([np.radians(longitude_deg), np.radians(latitude_deg), radius], axis=1)
