"""A circle on a body, around a direction from its centre."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.shape.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Circle:
    """Points within a distance along the surface of where a direction leaves the body.

    Parameters
    ----------
    up : (3,) ndarray
        Unit vector from the body's centre.
    radius : float
        Metres.
    """

    up: FloatArray
    radius: float

    def holds(self, points: ArrayLike) -> BoolArray:
        """Return which body-fixed points (…, 3), metres, lie within: a mask (…)."""
        places = np.asarray(points, dtype=np.float64)
        across = np.linalg.norm(np.cross(self.up, places), axis=-1)
        angle = np.arctan2(across, places @ self.up)
        within: BoolArray = angle * np.linalg.norm(places, axis=-1) <= self.radius
        return within

    def cut(self, mesh: Mesh, margin: float) -> Mesh:
        """Return the facets of a mesh that reach into the circle widened by `margin` metres.

        Raises
        ------
        InvalidValueError
            If there are none.
        """
        corners = mesh.corners
        middle = corners.mean(axis=1)
        reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        # Along a round surface the way is up to π/2 times the chord.
        wider = replace(self, radius=self.radius + margin + 0.5 * np.pi * float(reach.max()))
        near = np.flatnonzero(wider.holds(middle))
        if not near.size:
            raise InvalidValueError("has no facet in the circle", mesh.name)
        used, facets = np.unique(mesh.facets[near], return_inverse=True)
        return replace(mesh, vertices=mesh.vertices[used], facets=facets.reshape(-1, 3))
