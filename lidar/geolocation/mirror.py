"""Correction of the beams of a scanning lidar for errors of its mirror angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray


@dataclass(frozen=True)
class MirrorAngles:
    """Errors of the mirror angles.

    In the frame of the lidar, Z its boresight: a beam of length ρ is ρ (sin a cos e, sin e,
    cos a cos e), a the azimuth and e the elevation. The true azimuth is a + offset + scale·a, and
    likewise the elevation.

    Parameters
    ----------
    offset_rad : (float, float)
        Offsets of azimuth and elevation.
    scale : (float, float)
        Relative errors of both.
    """

    offset_rad: tuple[float, float] = (0.0, 0.0)
    scale: tuple[float, float] = (0.0, 0.0)

    def __bool__(self) -> bool:
        return any((*self.offset_rad, *self.scale))

    @property
    def most(self) -> float:
        """Largest rotation of a beam, radians, in any direction."""
        azimuth, elevation = np.abs(self.offset_rad) + np.abs(self.scale) * [np.pi, np.pi / 2.0]
        return float(azimuth + elevation)

    def corrected(self, beam: FloatArray) -> FloatArray:
        """Return the true beams (N, 3) of `beam` (N, 3) as located, with unchanged lengths.

        Both are in the frame of the lidar. NaN remains NaN.
        """
        length = np.linalg.norm(beam, axis=1)
        across = np.hypot(beam[:, 0], beam[:, 2])
        azimuth = np.arctan2(beam[:, 0], beam[:, 2])
        elevation = np.arctan2(beam[:, 1], across)
        azimuth = azimuth * (1.0 + self.scale[0]) + self.offset_rad[0]
        elevation = elevation * (1.0 + self.scale[1]) + self.offset_rad[1]
        flat = length * np.cos(elevation)
        columns = [flat * np.sin(azimuth), length * np.sin(elevation), flat * np.cos(azimuth)]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class MirrorMotion:
    """Displacement of the returns of one scan by such an error.

    Attributes
    ----------
    angles : MirrorAngles
    time : (K,) ndarray
        Seconds, ascending.
    station : (K, 3) ndarray
        Position of the lidar, body-fixed, metres, by which the returns were located.
    axes : (K, 3, 3) ndarray
        Rows: the axes of its frame, body-fixed; interpolated linearly.
    """

    angles: MirrorAngles
    time: FloatArray
    station: FloatArray
    axes: FloatArray

    def apply(self, points: FloatArray, time: FloatArray) -> FloatArray:
        """Return the points (N, 3), metres, along the true beams."""
        station = self._at(self.station, time)
        axes = self._at(self.axes.reshape(-1, 9), time).reshape(-1, 3, 3)
        beam = np.einsum("nij,nj->ni", axes, points - station)
        aside = self.angles.corrected(beam) - beam
        moved: FloatArray = points + np.einsum("nji,nj->ni", axes, aside)
        return moved

    def reach(self, radius: float) -> float:
        """Return the largest displacement of a point within `radius` of the origin, metres."""
        away = np.linalg.norm(self.station, axis=1).max(initial=0.0)
        return float(self.angles.most * (away + radius))

    def _at(self, values: FloatArray, time: FloatArray) -> FloatArray:
        return np.stack([np.interp(time, self.time, column) for column in values.T], axis=1)
