"""Type of terrain on the synthetic body: flags of a direction."""

from __future__ import annotations

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.compilation import compiled
from spcola.truth.body.cells import cell_at, face_place
from spcola.truth.body.relief import OUTLINE, boulder_square, from_centre
from spcola.truth.body.surface import Surface

BOULDER = 1
"""Inside the outline of a boulder, where it meets the ground."""
CRATER = 2
"""Inside the rim of a crater."""
SMOOTH = 4
"""On the smooth site."""


@compiled
def flag(
    surface: Surface, directions: FloatArray, boulders: int, craters: int, out: AnyArray
) -> None:
    """Fill `out` (N,) with the flags of the unit `directions` (N, 3).

    Only the first `boulders` and `craters` of the catalogues, the largest, are used.
    """
    size, site = surface.radius, surface.site
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        face, s, t = face_place(x, y, z)
        flags = 0
        index = surface.boulders
        cell = cell_at(face, s, t, index.cells)
        for place in range(index.start[cell], index.start[cell + 1]):
            item = index.items[place]
            if item < boulders:
                square = boulder_square(x, y, z, size, index.numbers[item])
                flags |= BOULDER if square < OUTLINE * OUTLINE else 0
        index = surface.craters
        cell = cell_at(face, s, t, index.cells)
        for place in range(index.start[cell], index.start[cell + 1]):
            item = index.items[place]
            if item < craters:
                flags |= CRATER if from_centre(x, y, z, size, index.numbers[item]) < 1.0 else 0
        dx, dy, dz = x - site[0], y - site[1], z - site[2]
        if np.sqrt(dx * dx + dy * dy + dz * dz) < site[3]:
            flags |= SMOOTH
        out[i] = flags
