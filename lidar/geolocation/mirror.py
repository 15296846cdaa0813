"""Beams of a scanning lidar whose mirror stood elsewhere than its angles say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray


@dataclass(frozen=True)
class MirrorAngles:
    """By how much the angles of the mirror are wrong.

    In the frame of the lidar, Z its boresight: a beam of the length ρ is ρ (sin a cos e, sin e,
    cos a cos e), a the azimuth and e the elevation. The true ones are a + offset + scale·a, and so
    with e.

    Parameters
    ----------
    offset_rad : (float, float)
        Of azimuth and elevation: what they say at rest.
    scale : (float, float)
        Relative errors of both.
    """

    offset_rad: tuple[float, float] = (0.0, 0.0)
    scale: tuple[float, float] = (0.0, 0.0)

    def __bool__(self) -> bool:
        return any((*self.offset_rad, *self.scale))

    @property
    def most(self) -> float:
        """By how much a beam is turned at most, radians, wherever it points."""
        azimuth, elevation = np.abs(self.offset_rad) + np.abs(self.scale) * [np.pi, np.pi / 2.0]
        return float(azimuth + elevation)

    def corrected(self, beam: FloatArray) -> FloatArray:
        """Return where beams (N, 3), in the frame of the lidar, really went; as long as they were.

        NaN stays NaN.
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
    """How such an error moves the returns of one scan.

    Attributes
    ----------
    angles : MirrorAngles
    time : (K,) ndarray
        Seconds, ascending.
    station : (K, 3) ndarray
        Where the lidar was, body-fixed, metres, as the returns were located.
    axes : (K, 3, 3) ndarray
        Rows: the axes of its frame, body-fixed; straight lines between the times.
    """

    angles: MirrorAngles
    time: FloatArray
    station: FloatArray
    axes: FloatArray

    def apply(self, points: FloatArray, time: FloatArray) -> FloatArray:
        """Return the points (N, 3), metres, where the beams really went."""
        station = self._at(self.station, time)
        axes = self._at(self.axes.reshape(-1, 9), time).reshape(-1, 3, 3)
        beam = np.einsum("nij,nj->ni", axes, points - station)
        aside = self.angles.corrected(beam) - beam
        moved: FloatArray = points + np.einsum("nji,nj->ni", axes, aside)
        return moved

    def reach(self, radius: float) -> float:
        """Return by how much a point within `radius` of the origin moves at most, metres."""
        away = np.linalg.norm(self.station, axis=1).max(initial=0.0)
        return float(self.angles.most * (away + radius))

    def _at(self, values: FloatArray, time: FloatArray) -> FloatArray:
        return np.stack([np.interp(time, self.time, column) for column in values.T], axis=1)
