"""Scans: the returns of a laser altimeter, with its positions and beams."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from spcola.arrays import AnyArray, FloatArray, check_finite, check_shape, read_only
from spcola.errors import InvalidValueError

MEASURES = ("time", "range", "spacecraft", "beam", "points", "intensity", "flag", "sigma")
"""The layers of a scan that have one entry per return."""


@dataclass(frozen=True, eq=False)
class Scan:
    """Returns of one scan (or track, or table of single shots); N of them.

    Only accepted returns are in a scan; rejected ones are counted in `rejected`. A quantity that
    the instrument or the format does not give is NaN.

    Parameters
    ----------
    name : str
        Identifies the scan in the workspace.
    time : (N,) ndarray
        Ephemeris time (TDB seconds past J2000); NaN if unknown.
    range : (N,) ndarray
        Measured range, metres, from the instrument's own reference point.
    spacecraft : (N, 3) ndarray
        Position of the spacecraft at the shot, body-fixed, metres.
    beam : (N, 3) ndarray
        Unit vector from the spacecraft to the return, body-fixed.
    points : (N, 3) ndarray
        Body-fixed positions of the returns, metres; always finite.
    intensity : (N,) ndarray
        Instrument units.
    flag : (N,) integer ndarray
        The instrument's flag, as in the file.
    sigma : (N,) ndarray
        One standard deviation of the range of a single return, metres.
    trajectory : str
        Name of the trajectory by which the points were located.
    body : str
        Name of the body-fixed frame.
    rejected : mapping of str to int
        Returns left out, counted by reason.

    Raises
    ------
    InvalidValueError
        If the layers differ in length or a point is not finite.
    """

    name: str
    time: FloatArray
    range: FloatArray
    spacecraft: FloatArray
    beam: FloatArray
    points: FloatArray
    intensity: FloatArray
    flag: AnyArray
    sigma: FloatArray
    trajectory: str = "reference"
    body: str = "body-fixed"
    rejected: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.points)
        for name in MEASURES:
            array = np.asarray(getattr(self, name))
            three = name in ("spacecraft", "beam", "points")
            check_shape(array, (count, 3) if three else (count,), f"{self.name}.{name}")
            if name != "flag" and array.dtype != np.float64:
                raise InvalidValueError(
                    f"is {array.dtype}, float64 is needed", f"{self.name}.{name}"
                )
            object.__setattr__(self, name, read_only(array))
        check_finite(self.points, f"{self.name}.points")
        object.__setattr__(self, "rejected", MappingProxyType(dict(self.rejected)))

    @classmethod
    def of_points(cls, name: str, points: FloatArray, **known: AnyArray | str) -> Scan:
        """Build the scan `name` from `points` (N, 3), metres, and the `known` layers only.

        All other layers are NaN (flags are 0: a point without a flag counts as valid). Where the
        spacecraft is known, range and beam that are not given follow from it.
        """
        count = len(points)
        layers: dict[str, AnyArray | str] = {
            "time": np.full(count, np.nan),
            "spacecraft": np.full((count, 3), np.nan),
            "intensity": np.full(count, np.nan),
            "flag": np.zeros(count, dtype=np.int16),
            "sigma": np.full(count, np.nan),
            **known,
        }
        away = points - layers["spacecraft"]  # type: ignore[operator]
        distance = np.linalg.norm(away, axis=1)
        layers.setdefault("range", distance)
        if "beam" not in layers:
            with np.errstate(invalid="ignore", divide="ignore"):
                layers["beam"] = away / distance[:, None]
        return cls(name=name, points=points, **layers)  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.points)

    def select(self, keep: AnyArray) -> Self:
        """Return the returns chosen by `keep` (mask, slice or indices)."""
        kept: dict[str, Any] = {name: getattr(self, name)[keep] for name in MEASURES}
        return replace(self, **kept)

    def with_points(self, points: FloatArray, **changed: AnyArray | str) -> Self:
        """Return the scan with its returns at other `points` (N, 3), m, and layers `changed`."""
        return replace(self, points=points, **changed)  # type: ignore[arg-type]

    @property
    def reference_offset(self) -> FloatArray:
        """Distance from spacecraft to point less the measured range (N,), metres.

        Not zero where the range has another reference point than the spacecraft position
        (1.05–1.25 m in OLA's tables).
        """
        distance: FloatArray = np.linalg.norm(self.points - self.spacecraft, axis=1)
        return distance - self.range


def join(name: str, scans: list[Scan]) -> Scan:
    """Join chunks of one scan in the order given; rejection counts add up.

    Parameters
    ----------
    name : str
        Of the joined scan.
    scans : list of Scan

    Raises
    ------
    InvalidValueError
        If there is nothing to join, or the chunks name different trajectories or bodies.
    """
    if not scans:
        raise InvalidValueError("has no chunk to join", name)
    first = scans[0]
    if any((s.trajectory, s.body) != (first.trajectory, first.body) for s in scans):
        raise InvalidValueError("chunks lie in different frames", name)
    rejected: Counter[str] = Counter()
    for scan in scans:
        rejected.update(scan.rejected)
    layers: dict[str, Any] = {
        measure: np.concatenate([getattr(scan, measure) for scan in scans]) for measure in MEASURES
    }
    return replace(first, name=name, rejected=rejected, **layers)
