"""What a distortion model is, and helpers of its partials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray

Displacement = tuple[FloatArray, FloatArray, FloatArray]
"""dx, dy (…), mm, and their partials (…, 2, 2) by x, y."""


@dataclass(frozen=True)
class DistortionForm:
    """One distortion model.

    Parameters
    ----------
    counts : tuple of int
        Numbers of coefficients that it may have.
    shift : callable
        ``shift(coefficients, x, y, focal_mm)`` with x, y (…) in mm returns dx, dy and their
        partials (…, 2, 2).
    corrects : bool
        False: x, y are gnomonic and the true position is (x + dx, y + dy), as in [2]. True: x, y
        are the true (distorted) position and the gnomonic one is (x + dx, y + dy), as ISIS and CSM
        define many models.
    """

    counts: tuple[int, ...]
    shift: Callable[[FloatArray, FloatArray, FloatArray, float], Displacement]
    corrects: bool = False


def partials(xx: FloatArray, xy: FloatArray, yx: FloatArray, yy: FloatArray) -> FloatArray:
    """Return ∂dx/∂x, ∂dx/∂y, ∂dy/∂x, ∂dy/∂y (…) as (…, 2, 2)."""
    rows = [np.stack([xx, xy], axis=-1), np.stack([yx, yy], axis=-1)]
    return np.stack(rows, axis=-2)


def along_radius(
    factor: FloatArray, per_r2: FloatArray, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return the partials (…, 2, 2) of ``factor · (x, y)``.

    Parameters
    ----------
    factor : (…) ndarray
        A function of r² = x² + y².
    per_r2 : (…) ndarray
        Its derivative by r².
    x, y : (…) ndarray
        mm.
    """
    slope = 2.0 * per_r2
    cross = slope * x * y
    return partials(factor + slope * x * x, cross, cross, factor + slope * y * y)
