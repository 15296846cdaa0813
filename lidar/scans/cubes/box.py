"""A box in space that contains all returns that may fall on a grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import BoolArray, FloatArray, frozen
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
# Rounding of the coordinates in a grid's frame must not leave a return outside, metres.
_ROUNDING_M = 1e-6


@dataclass(frozen=True, eq=False)
class Box:
    """The points within `half` of `center` along each of three axes.

    Parameters
    ----------
    center : (3,) array_like
        Body-fixed, metres.
    axes : (3, 3) array_like
        Rows are unit vectors, perpendicular to each other.
    half : (3,) array_like
        Half the length along each axis, metres.

    Raises
    ------
    InvalidValueError
        If a shape differs, or a length is negative.
    """

    center: FloatArray
    axes: FloatArray
    half: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", frozen(self.center, (3,), "center"))
        object.__setattr__(self, "axes", frozen(self.axes, (3, 3), "axes"))
        object.__setattr__(self, "half", frozen(self.half, (3,), "half"))
        if not (self.half >= 0).all():
            raise InvalidValueError("must not be negative", "half")

    @classmethod
    def over(cls, grid: MapletGrid, reach: float) -> Box:
        """Return the box of the cells of `grid` within `reach` metres of its plane.

        A cell reaches half a step beyond its grid point.
        """
        side = (grid.half_size + 0.5) * grid.gsd
        return cls(grid.center, grid.axes, np.array([side, side, reach]) + _ROUNDING_M)

    @property
    def corners(self) -> FloatArray:
        """The eight corners (8, 3), metres."""
        return self.center + (_CORNERS * self.half) @ self.axes

    @property
    def radius(self) -> float:
        """Distance of the corners from the centre, metres."""
        return float(np.linalg.norm(self.half))

    def grown(self, by: float) -> Box:
        """Return the box extended by `by` metres on all sides."""
        return replace(self, half=self.half + by)

    def mapped(self, transform: Callable[[FloatArray], FloatArray]) -> Box:
        """Return a box that contains the image of this one, rotated with it.

        `transform` takes points (N, 3) and is affine, so that corners bound the image.
        """
        steps = transform(self.center + np.vstack([np.zeros(3), self.axes]))
        # The rotation nearest to the images of the axes, which need not be perpendicular.
        left, _, right = np.linalg.svd(steps[1:] - steps[0])
        axes = left @ right
        along = transform(self.corners) @ axes.T
        low, high = along.min(axis=0), along.max(axis=0)
        return Box((low + high) / 2.0 @ axes, axes, (high - low) / 2.0)

    def holds(self, points: ArrayLike) -> BoolArray:
        """Return which of the points (N, 3) lie inside (N,)."""
        along = (np.asarray(points, dtype=np.float64) - self.center) @ self.axes.T
        inside: BoolArray = np.all(np.abs(along) <= self.half, axis=1)
        return inside

    def touches(self, middles: FloatArray, reach: ArrayLike) -> BoolArray:
        """Return which balls (N,) of radius `reach` about `middles` (N, 3) may have a point inside.

        True for all that have; also for some outside the edges and corners of the box.
        """
        along = np.abs((middles - self.center) @ self.axes.T)
        limit = self.half + np.asarray(reach, dtype=np.float64)[..., None]
        close: BoolArray = np.all(along <= limit, axis=1)
        return close
