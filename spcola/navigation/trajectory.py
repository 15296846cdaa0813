"""Trajectories: positions of the spacecraft, body-fixed, and their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from spcola.arrays import BoolArray, FloatArray, IntArray, check_finite, frozen
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError
from spcola.navigation.time import et_from_utcs


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions of the spacecraft at N times.

    Parameters
    ----------
    name : str
        Name in scans and manifests.
    time : (N,) array_like
        Ephemeris time (TDB seconds past J2000), strictly increasing.
    position : (N, 3) array_like
        Body-fixed, metres.
    sigma : (N, 3) array_like, optional
        One standard deviation along the body-fixed axes, metres; NaN if unknown.

    Raises
    ------
    InvalidValueError
        If there is no time, the times do not increase, or a value is not finite.
    """

    name: str
    time: FloatArray
    position: FloatArray
    sigma: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__

    def __post_init__(self) -> None:
        time = frozen(self.time, (None,), f"{self.name}.time")
        count = len(time)
        sigma = np.full((count, 3), np.nan) if self.sigma is None else self.sigma
        object.__setattr__(self, "time", time)
        object.__setattr__(
            self, "position", frozen(self.position, (count, 3), f"{self.name}.position")
        )
        object.__setattr__(self, "sigma", frozen(sigma, (count, 3), f"{self.name}.sigma"))
        check_finite(time, f"{self.name}.time")
        check_finite(self.position, f"{self.name}.position")
        if count == 0:
            raise InvalidValueError("has no position", self.name)
        if np.any(np.diff(time) <= 0):
            place = int(np.argmax(np.diff(time) <= 0)) + 2
            raise InvalidValueError(
                f"time {place} does not follow the one before", self.name, "sort, drop doubles"
            )

    @classmethod
    def from_images(cls, images: Sequence[SpcImage], *, name: str = "spc") -> Trajectory:
        """Build one with a `name` from the solved states of `images`, in any order.

        Raises
        ------
        InvalidValueError
            If two images have one time, or there is none.
        FormatError
            If the time of an image cannot be read.
        """
        times = et_from_utcs([image.utc for image in images])
        order = np.argsort(times, kind="stable")
        positions = np.array([images[i].position for i in order]).reshape(-1, 3)
        sigma = np.array([images[i].scobj_sigma for i in order]).reshape(-1, 3)
        return cls(name, times[order], positions, sigma)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, s."""
        return float(self.time[0]), float(self.time[-1])

    def covers(self, times: ArrayLike, *, max_gap_s: float = np.inf) -> BoolArray:
        """Return whether times (N,) lie between two of the trajectory's no more than a gap apart.

        A time of the trajectory itself is covered whatever the gaps next to it.

        Parameters
        ----------
        times : (N,) array_like
            Ephemeris times, s.
        max_gap_s : float
            Largest gap between two positions that is interpolated, seconds.
        """
        wanted = np.asarray(times, dtype=np.float64)
        low, high, share = bracket(self.time, wanted)
        inside = (wanted >= self.time[0]) & (wanted <= self.time[-1])
        short = self.time[high] - self.time[low] <= max_gap_s
        return inside & (short | (share == 0) | (share == 1))

    def at(self, times: ArrayLike, *, max_gap_s: float = np.inf) -> FloatArray:
        """Return positions (N, 3), metres, at times (N,); NaN where not covered.

        A cubic spline from four positions on, straight lines with fewer. Positions far apart in a
        body-fixed trajectory turn with the body: interpolate differences to another trajectory
        instead (`offset_from`).

        Parameters
        ----------
        times : (N,) array_like
            Ephemeris times, s.
        max_gap_s : float
            Largest gap between two positions that is interpolated, seconds.
        """
        wanted = np.asarray(times, dtype=np.float64)
        covered = self.covers(wanted, max_gap_s=max_gap_s)
        positions = np.full((len(wanted), 3), np.nan)
        if len(self.time) >= 4:
            # As long to import as all of NumPy.
            from scipy.interpolate import CubicSpline  # noqa: PLC0415

            positions[covered] = CubicSpline(self.time, self.position)(wanted[covered])
        else:
            positions[covered] = straight_lines(self.time, self.position, wanted[covered])
        return positions

    def offset_from(self, reference: Trajectory, *, max_gap_s: float = np.inf) -> Offset:
        """Return this trajectory less `reference`, at those of its times that `reference` covers.

        A gap in `reference` longer than `max_gap_s` (seconds) covers nothing.

        Raises
        ------
        InvalidValueError
            If `reference` covers none of the times.
        """
        there = reference.at(self.time, max_gap_s=max_gap_s)
        known = np.isfinite(there).all(axis=1)
        if not known.any():
            raise InvalidValueError(
                f"covers no time of {self.name!r}", reference.name, "use scans of the same days"
            )
        return Offset(
            Trajectory(
                self.name, self.time[known], (self.position - there)[known], self.sigma[known]
            )
        )


@dataclass(frozen=True, eq=False)
class Offset:
    """The difference of two trajectories, smooth enough for linear interpolation.

    Parameters
    ----------
    differences : Trajectory
        Its positions are differences, metres; its sigma is that of the newer trajectory.
    """

    differences: Trajectory

    def widest(self, max_gap_s: float) -> float:
        """Return the sigma of linear interpolation in the middle of the longest gap, metres.

        It is that of a Brownian bridge whose increments are those of the differences (`drift`), of
        the gaps not longer than `max_gap_s`, seconds; 0 where nothing is interpolated.
        """
        gaps = np.diff(self.differences.time)
        gaps = gaps[gaps <= max_gap_s]
        return float(np.sqrt(self.drift.sum() * gaps.max() / 4.0)) if gaps.size else 0.0

    def shares(self, times: ArrayLike) -> csr_array:
        """Return the weight (M, K), sparse, of each of the K differences at times (M,).

        The error of an interpolated value is the sum of those of two states with these weights. A
        row is zero where its time is not covered.
        """
        track = self.differences
        wanted = np.asarray(times, dtype=np.float64)
        covered = np.flatnonzero(track.covers(wanted))
        low, high, share = bracket(track.time, wanted[covered])
        weights = np.concatenate([1.0 - share, share])
        places = (np.tile(covered, 2), np.concatenate([low, high]))
        return csr_array((weights, places), shape=(len(wanted), len(track)))

    @property
    def drift(self) -> FloatArray:
        """Growth of the variance of the difference (3,), m²/s; NaN from one time only."""
        if len(self.differences) < 2:
            return np.full(3, np.nan)
        steps = np.diff(self.differences.position, axis=0)
        return np.mean(steps**2 / np.diff(self.differences.time)[:, None], axis=0)


def bracket(time: FloatArray, wanted: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the indices (M,) of the times around each wanted one, and its share of the step."""
    low = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, max(len(time) - 2, 0))
    high = np.minimum(low + 1, len(time) - 1)
    step = np.where(high > low, time[high] - time[low], 1.0)
    return low, high, np.clip((wanted - time[low]) / step, 0.0, 1.0)


def straight_lines(time: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    """Interpolate values (N, 3) linearly at wanted times (M,): (M, 3)."""
    low, high, share = bracket(time, wanted)
    return values[low] + share[:, None] * (values[high] - values[low])
