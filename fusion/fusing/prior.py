"""The surface that bridges what neither slopes of images nor returns tell."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.gaps import carried_on
from spcola.maplet import Maplet
from spcola.photoclinometry import SlopeVariance


def bridging_surface(shape: FloatArray, spc: Maplet, light: SlopeVariance | None) -> FloatArray:
    """Return SPC's heights as far as it goes, then those of the shape (2q+1, 2q+1), metres.

    What SPC filled in without slopes from images is no more than a shape, but one without a step at
    the border. The `shape` (NaN where there is none) is bent onto it: a gap at a border between the
    two must not be bridged by the difference of both. Without knowledge of the `light` there is
    nothing that SPC filled in, and the shape is what bridges.
    """
    if light is None:
        return shape
    bent = shape + np.nan_to_num(carried_on(spc.height - shape))
    return np.where(spc.valid, spc.height, bent)
