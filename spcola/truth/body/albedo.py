"""The relative albedo of the synthetic body: noise about 1, and isolated bright and dark spots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled
from spcola.truth.body.cells import Indexed, cell_of
from spcola.truth.body.relief import spot_albedo
from spcola.truth.body.roughness import add_noise
from spcola.truth.body.surface import BLOCK


class AlbedoField(NamedTuple):
    """Parameters of the albedo for the kernels; lengths in metres."""

    radius: float
    octaves: FloatArray
    seed: int
    spots: Indexed


@compiled
def albedos(field: AlbedoField, directions: FloatArray, out: FloatArray) -> None:
    """Fill `out` (N,) with the relative albedo in each of the unit `directions` (N, 3)."""
    places, value = np.empty((3, BLOCK)), np.empty(BLOCK)
    for start in range(0, len(out), BLOCK):
        end = min(start + BLOCK, len(out))
        for i in range(start, end):
            for axis in range(3):
                places[axis, i - start] = field.radius * directions[i, axis]
            value[i - start] = 1.0
        add_noise(places, field.octaves, field.seed, value, end - start)
        for i in range(start, end):
            out[i] = value[i - start]
            x, y, z = directions[i]
            cell = cell_of(x, y, z, field.spots.cells)
            for place in range(field.spots.start[cell], field.spots.start[cell + 1]):
                spot = field.spots.numbers[field.spots.items[place]]
                out[i] += spot_albedo(x, y, z, field.radius, spot)
