"""Array types, and checks of the arrays of value objects."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spcola.errors import InvalidValueError

FloatArray = NDArray[np.floating[Any]]
"""Floating-point array; shape and unit are in the docstring of its user."""
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.integer[Any]]
AnyArray = NDArray[Any]


def frozen(values: ArrayLike, shape: tuple[int | None, ...], name: str) -> FloatArray:
    """Return a read-only float64 copy of `values`; an InvalidValueError unless it has `shape`.

    ``None`` in `shape` stands for any length. The copy ensures that the caller cannot change the
    array of a frozen value.
    """
    array = np.array(values, dtype=np.float64)
    check_shape(array, shape, name)
    array.setflags(write=False)
    return array


def read_only(array: AnyArray) -> AnyArray:
    """Return a read-only view of `array` without copying it (for large, freshly made arrays)."""
    view = array.view()
    view.setflags(write=False)
    return view


def check_shape(array: AnyArray, shape: tuple[int | None, ...], name: str) -> None:
    """Raise an InvalidValueError unless `array` has `shape` (``None``: any length)."""
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = " × ".join("any" if want is None else str(want) for want in shape)
        raise InvalidValueError(f"has shape {array.shape}, {wanted} is needed", name)


def check_finite(array: AnyArray, name: str) -> None:
    """Raise an InvalidValueError if `array` contains NaN or infinity."""
    if not np.all(np.isfinite(array)):
        raise InvalidValueError("holds a value that is not finite", name)


def check_axes(axes: FloatArray, name: str, tolerance: float = 1e-5) -> None:
    """Raise an InvalidValueError unless `axes` (3, 3), in rows, are orthonormal and right-handed.

    The tolerance allows for axes in files with seven digits.
    """
    check_finite(axes, name)
    if np.max(np.abs(axes @ axes.T - np.eye(3))) > tolerance:
        raise InvalidValueError("axes are not orthonormal", name)
    if np.linalg.det(axes) < 0:
        raise InvalidValueError("axes are left-handed (x × y = −z)", name)
