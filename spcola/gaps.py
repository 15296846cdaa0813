"""Unknown points of a grid: what the known ones around say of them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from spcola.arrays import FloatArray


def carried_on(layer: FloatArray) -> FloatArray:
    """Return a layer (R, C) in which each unknown point has the value of the nearest known one.

    NaN everywhere if no point is known.
    """
    unknown = np.isnan(layer)
    if not unknown.any() or unknown.all():
        return layer
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    whole: FloatArray = layer[tuple(nearest)]
    return whole
