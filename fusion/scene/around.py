"""Maplets around one, which may hide and shade its ground."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spcola.arrays import FloatArray
from spcola.grids import Maplet, MapletGrid
from spcola.shape import RayCaster
from spcola.shape.tiling import mesh_of_maplets

# Maplets that reach to within so many radii of the centre of another may hide and shade its ground;
# their facets there have a side of so many of its GSDs.
_REACH, _STEP = 3.0, 2.0


@dataclass(frozen=True, eq=False)
class NearMaplets:
    """Finds the maplets that are near enough to hide and shade the ground of another.

    Parameters
    ----------
    grids : mapping of str to MapletGrid
        Of all maplets.
    """

    grids: Mapping[str, MapletGrid]

    def around(self, name: str) -> list[str]:
        """Return the names of the maplets around one, in the order of the grids.

        Parameters
        ----------
        name : str
            Of one of the maplets.
        """
        centers, radii = self._places
        own = self.grids[name]
        near = np.linalg.norm(centers - own.center, axis=1) < radii + _REACH * own.radius
        names = list(self.grids)
        return [names[k] for k in np.flatnonzero(near) if names[k] != name]

    @cached_property
    def _places(self) -> tuple[FloatArray, FloatArray]:
        """Centres (N, 3) and radii (N,) of all, metres."""
        grids = self.grids.values()
        return np.array([grid.center for grid in grids]), np.array([grid.radius for grid in grids])


def caster_around(maplets: Iterable[Maplet], gsd: float) -> RayCaster | None:
    """Return the surface of the maplets around one; None if none of them has a height.

    Parameters
    ----------
    maplets : iterable of Maplet
    gsd : float
        Of the one that they hide and shade, metres.
    """
    known = [maplet for maplet in maplets if maplet.valid.any()]
    return RayCaster(mesh_of_maplets(known, _STEP * gsd)) if known else None
