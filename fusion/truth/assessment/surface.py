"""Interface of a truth surface, as the assessment uses it."""

from __future__ import annotations

from typing import Protocol

from spcola.arrays import AnyArray, FloatArray
from spcola.grids import MapletGrid
from spcola.truth.body import SurfacePoints


class TruthSurface(Protocol):
    """A surface that is known everywhere, as :class:`spcola.truth.body.TruthBody` is."""

    def radius(self, directions: FloatArray) -> FloatArray:
        """Return the radius (N,), metres, in `directions` (N, 3)."""

    def nearest(self, points: FloatArray) -> SurfacePoints:
        """Return the points of the surface that are nearest to `points` (N, 3), metres."""

    def heights(self, grid: MapletGrid) -> FloatArray:
        """Return the heights (2q+1, 2q+1), metres, along Uz; NaN where there are several."""

    def heights_near(self, grid: MapletGrid, model: FloatArray) -> FloatArray:
        """Return the heights (2q+1, 2q+1), metres, that those of a model (2q+1, 2q+1) stand for."""

    def terrain(self, directions: FloatArray, *, smallest: float) -> AnyArray:
        """Return terrain flags (N,), for features of at least `smallest` metres."""
