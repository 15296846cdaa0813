"""Illumination of the body: the share of a rotation during which the ground is lit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import SettingsError
from spcola.truth.sampled.cube import Tiling, look_up, tile_directions

_FACES = np.arange(6)
_CHUNK = 250_000


class ShadowedSurface(Protocol):
    """A surface with occlusion, such as ``SampledSurface``."""

    def radius(self, directions: FloatArray) -> FloatArray:
        """Return the radius (N,), metres, in `directions` (N, 3)."""

    def occluded(self, points: FloatArray, toward: FloatArray) -> BoolArray:
        """Return whether ground stands in the way from `points` (N, 3) towards (N, 3)."""


@dataclass(frozen=True, eq=False)
class LightMap:
    """The share of a rotation, 0 … 1, during which each place of the body is lit.

    Ground is lit if the incidence is below a limit and it lies in no cast shadow. The shares are
    stored at the nodes of a cube's six faces.

    Parameters
    ----------
    tiling : Tiling
        One tile to a face.
    shares : (6, M) ndarray of float32
        Of the nodes, in the order of the tiling.
    """

    tiling: Tiling
    shares: FloatArray

    @classmethod
    def of(
        cls,
        surface: ShadowedSurface,
        *,
        sun_latitude: float,
        spacing: float = 1.5,
        hours: int = 24,
        most_incidence: float = np.radians(80.0),
    ) -> LightMap:
        """Follow the Sun through a rotation.

        Parameters
        ----------
        surface : SampledSurface
            Surface of the body.
        sun_latitude : float
            Latitude of the sub-solar point, radians.
        spacing : float
            Greatest distance between nodes, metres; slopes are those between neighbours.
        hours : int
            Number of moments of the rotation, evenly spread.
        most_incidence : float
            Beyond this angle from the normal the ground counts as dark, radians, since SPC
            solutions do not use it. 80° by default.

        Raises
        ------
        SettingsError
            If a setting is out of range.
        """
        if not (np.isfinite(spacing) and spacing > 0 and hours >= 1):
            raise SettingsError("spacing or number of hours too small", "light map")
        if not (abs(sun_latitude) <= np.pi / 2 and 0 < most_incidence <= np.pi / 2):
            raise SettingsError("latitude of the Sun or incidence out of range", "light map")
        tiling, points = _nodes(surface, spacing)
        normals = _normals(points)
        points = points.reshape(-1, 3)
        lit = np.zeros(len(points), dtype=np.float32)
        ring, height = np.cos(sun_latitude), np.sin(sun_latitude)
        for angle in 2.0 * np.pi * np.arange(hours) / hours:
            sun = np.array([ring * np.cos(angle), ring * np.sin(angle), height])
            day = np.flatnonzero(normals @ sun > np.cos(most_incidence))
            for first in range(0, len(day), _CHUNK):
                some = day[first : first + _CHUNK]
                lit[some] += np.logical_not(surface.occluded(points[some], sun))
        return cls(tiling, (lit / np.float32(hours)).reshape(6, -1))

    def at(self, directions: FloatArray) -> FloatArray:
        """Return the share (N,), 0 … 1, in `directions` (N, 3) of any length: bilinear."""
        out = np.empty(len(directions))
        rows = np.ascontiguousarray(directions, np.float64)
        look_up(self.tiling, _FACES, self.shares, rows, out)
        return out


def _nodes(surface: ShadowedSurface, spacing: float) -> tuple[Tiling, FloatArray]:
    """Return a tiling of that spacing, and the surface at its nodes (6, S, S, 3), metres."""
    coarse = Tiling.of(1, 16, 0.0)
    tiling = Tiling.of(1, _cells(tile_directions(coarse, _FACES), surface, spacing), 0.0)
    directions = tile_directions(tiling, _FACES)
    points = surface.radius(directions)[:, None] * directions
    side = tiling.size + 3
    return tiling, points.reshape(6, side, side, 3)


def _cells(directions: FloatArray, surface: ShadowedSurface, spacing: float) -> int:
    """Return the number of cells across a face whose width is at most `spacing`, metres."""
    return max(16, int(np.ceil(2.0 * float(surface.radius(directions).max()) / spacing)))


def _normals(points: FloatArray) -> FloatArray:
    """Return the outward unit normals (N, 3) of nodes (6, S, S, 3), from their neighbours."""
    along, across = (np.gradient(points, axis=axis) for axis in (1, 2))
    normals = np.cross(across, along)
    normals *= np.sign(np.sum(normals * points, axis=-1, keepdims=True))
    unit: FloatArray = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    return unit.reshape(-1, 3)
