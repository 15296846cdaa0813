"""Screening: acceptance of the records of a lidar file as returns, with reasons for the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lidar.formats.records.options import LidarOptions
from lidar.scans import Scan
from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.compilation import compiled, compiled_inline
from spcola.errors import FormatError

# 1950 to 2150: every altimeter that flew or will fly soon; a garbled time falls outside.
_EARLIEST_S, _LATEST_S = -1.6e9, 4.8e9
# No target of a lidar is further than a light-minute from the body's centre.
_FARTHEST_M = 2e10
# Reasons after those of the format's own flags; the first that applies is counted.
_REASONS = (
    "not finite",
    "no-echo sentinel",
    "not plausible",
    "time not plausible",
    "range and point disagree",
    "coordinates disagree",
    "outside the radius limits",
)


@dataclass(frozen=True, eq=False)
class Records:
    """Raw records of one chunk, N of them, in SI units; None: the file lacks the quantity.

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
        Records refused by the format's own flags, by reason; the first that applies is counted.
    unreadable : int
        Records too broken for the arrays.
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
    """Tolerances between two values of one quantity in a record.

    Parameters
    ----------
    offset_m : float
        Distance from spacecraft to point less the range, as expected of the instrument.
    tolerance_m : float
        Largest departure from it, and largest distance between two values of the position.
    """

    offset_m: float
    tolerance_m: float

    def adjusted(self, options: LidarOptions) -> Agreement:
        """Return the agreement with the values in `options`, which replace the format's own."""
        offset, tolerance = options.reference_offset_m, options.range_tolerance_m
        return Agreement(
            self.offset_m if offset is None else offset,
            self.tolerance_m if tolerance is None else tolerance,
        )


class Screen:
    """Converts the chunks of one file into scans, in order.

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
        verdict = self._verdict(records)
        sound = (verdict.code == 0) | (verdict.code >= verdict.first("range and point disagree"))
        if not self._units_known and sound.any():
            off = verdict.refused("range and point disagree", "coordinates disagree")
            self._check_units(sound, off, records)
            self._units_known = True
        self._check_radius(verdict, records.points)
        counts = verdict.counts
        if records.unreadable:
            counts["unreadable record"] = records.unreadable
        return self._scan(records, verdict.code == 0, counts)

    def _verdict(self, records: Records) -> _Verdict:
        """Return the first reason to refuse each record."""
        reasons = (*records.refused, *_REASONS)
        code = np.zeros(len(records.points), dtype=np.uint8)
        for number, mask in enumerate(records.refused.values(), start=1):
            code[mask & (code == 0)] = number
        low, high = self._options.radius_limits_m or (0.0, np.inf)
        vectors, numbers = np.empty((0, 3)), np.empty(0)
        _judge(
            code,
            len(records.refused),
            records.points,
            vectors if records.spacecraft is None else records.spacecraft,
            numbers if records.range is None else records.range,
            vectors if records.spherical is None else records.spherical,
            numbers if records.time is None else records.time,
            np.array([self._agreement.offset_m, self._agreement.tolerance_m, low, high]),
        )
        return _Verdict(code, reasons)

    def _check_units(self, tested: BoolArray, wrong: BoolArray, records: Records) -> None:
        """Refuse the file if most of its first sound records contradict themselves."""
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

    def _check_radius(self, verdict: _Verdict, points: FloatArray) -> None:
        """Refuse the file if hardly any return is within the radius limits."""
        limits = self._options.radius_limits_m
        if limits is None:
            return
        tested = (verdict.code == 0) | verdict.refused("outside the radius limits")
        if 2 * np.count_nonzero(verdict.code == 0) < np.count_nonzero(tested):
            raise FormatError(
                f"most returns lie outside the radius limits {limits[0]:g} to {limits[1]:g} m "
                f"(median {np.median(norms(points[tested])):.6g} m)",
                self._path,
                "check the unit of its coordinates (km for m?)",
            )

    def _scan(self, records: Records, kept: BoolArray, counts: dict[str, int]) -> Scan:
        options = self._options
        count = int(np.count_nonzero(kept))
        rows = None if count == len(kept) else np.flatnonzero(kept)

        def layer(values: AnyArray | None, default: AnyArray) -> AnyArray:
            if values is None:
                return default
            # Several times as fast as with the mask.
            return values if rows is None else values.take(rows, axis=0)

        unknown = np.full(count, np.nan)
        points = layer(records.points, unknown)
        spacecraft = layer(records.spacecraft, np.full((count, 3), np.nan))
        # No accepted return has distance zero, since its range would not be positive.
        beam, distance = _beams(points, spacecraft)
        return Scan(
            name=options.name or self._path.stem,
            time=layer(records.time, unknown),
            range=layer(records.range, distance),
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


@dataclass(frozen=True, eq=False)
class _Verdict:
    """The reason that refuses each record: its number among `reasons` from 1 on, or 0 (N,)."""

    code: AnyArray
    reasons: tuple[str, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Records refused, by reason; without the reasons that refused none."""
        numbers = np.bincount(self.code, minlength=len(self.reasons) + 1)[1:].tolist()
        return {r: n for r, n in zip(self.reasons, numbers, strict=True) if n}

    def first(self, reason: str) -> int:
        """Code of a reason."""
        return self.reasons.index(reason) + 1

    def refused(self, *reasons: str) -> BoolArray:
        """Mask (N,) of the records that one of the `reasons` refuses."""
        return np.isin(self.code, [self.first(reason) for reason in reasons])


@compiled
def _judge(
    code: AnyArray,
    before: int,
    points: FloatArray,
    spacecraft: FloatArray,
    ranges: FloatArray,
    spherical: FloatArray,
    time: FloatArray,
    limits: FloatArray,
) -> None:
    """Assign to each record not refused yet the number, after `before`, of its first reason.

    Layers missing in the format are empty. In the order of :data:`_REASONS`.
    """
    offset, tolerance, lowest, highest = limits
    for n in range(len(points)):
        if code[n] != 0:
            continue
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        radius = np.sqrt(x * x + y * y + z * z)
        finite = np.isfinite(radius)
        distance = measured = np.nan
        if len(spacecraft):
            away = 0.0
            for axis in range(3):
                away += (points[n, axis] - spacecraft[n, axis]) ** 2
            distance = measured = np.sqrt(away)
            finite &= np.isfinite(distance)
        if len(ranges):
            measured = ranges[n]
            finite &= np.isfinite(measured)
        if len(time):
            finite &= np.isfinite(time[n])
        if not finite:
            code[n] = before + 1
        elif measured <= 0:
            code[n] = before + 2
        elif radius > _FARTHEST_M:
            code[n] = before + 3
        elif len(time) and (time[n] < _EARLIEST_S or time[n] > _LATEST_S):
            code[n] = before + 4
        elif len(ranges) and len(spacecraft) and not abs(distance - measured - offset) <= tolerance:
            code[n] = before + 5
        elif len(spherical) and not _apart(points[n], spherical[n]) <= tolerance:
            code[n] = before + 6
        elif not (radius >= lowest and radius <= highest):
            code[n] = before + 7


@compiled_inline
def _apart(point: FloatArray, spherical: FloatArray) -> float:
    """Distance between two values of a position, metres."""
    level = spherical[2] * np.cos(spherical[1])
    x = level * np.cos(spherical[0]) - point[0]
    y = level * np.sin(spherical[0]) - point[1]
    z = spherical[2] * np.sin(spherical[1]) - point[2]
    return np.sqrt(x * x + y * y + z * z)


@compiled
def _beams(points: FloatArray, spacecraft: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (N, 3) from the spacecraft to the points, and the distances (N,), metres."""
    beam, distance = np.empty(points.shape), np.empty(len(points))
    for n in range(len(points)):
        square = 0.0
        for axis in range(3):
            square += (points[n, axis] - spacecraft[n, axis]) ** 2
        distance[n] = np.sqrt(square)
        for axis in range(3):
            beam[n, axis] = (points[n, axis] - spacecraft[n, axis]) / distance[n]
    return beam, distance


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
