"""States between those of a file: positions and axes at any times."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError


def interpolate_positions(
    times: FloatArray,
    positions: FloatArray,
    wanted: FloatArray,
    *,
    velocities: FloatArray | None = None,
) -> FloatArray:
    """Return positions (M, 3), m, at wanted times (M,).

    Cubic Hermite polynomials where velocities are known; otherwise a cubic spline, a parabola or a
    straight line, as many as the states allow.

    Parameters
    ----------
    times : (N,) ndarray
        s, increasing.
    positions : (N, 3) ndarray
        In a frame in which they are smooth.
    wanted : (M,) ndarray
        Between the first time and the last (to a microsecond); any times if there is one state.
    velocities : (N, 3) ndarray, optional
        m/s.

    Raises
    ------
    InvalidValueError
        If a wanted time is outside, or the states' times do not increase.
    """
    inside = _inside(times, wanted)
    if len(times) == 1:
        return np.repeat(positions, len(wanted), axis=0)
    # As long to import as all of NumPy; most programs need it never.
    from scipy.interpolate import CubicHermiteSpline, CubicSpline  # noqa: PLC0415

    if velocities is not None:
        found: FloatArray = CubicHermiteSpline(times, positions, velocities)(inside)
    elif len(times) > 3:
        found = CubicSpline(times, positions)(inside)
    else:
        fit = np.polynomial.polynomial.polyfit(times - times[0], positions, len(times) - 1)
        found = np.polynomial.polynomial.polyval(inside - times[0], fit).T
    return found


def interpolate_axes(
    times: FloatArray,
    axes: FloatArray,
    wanted: FloatArray,
    *,
    method: Literal["slerp", "cubic"] = "slerp",
) -> FloatArray:
    """Return axes (M, 3, 3) at wanted times (M,).

    Parameters
    ----------
    times : (N,) ndarray
        s, increasing.
    axes : (N, 3, 3) ndarray
        Rows are unit vectors, right-handed.
    wanted : (M,) ndarray
        Between the first time and the last (to a microsecond); any times if there is one state.
    method : {"slerp", "cubic"}
        Turns at a constant rate between two states; or a cubic spline of rotation vectors with
        continuous rate and acceleration.

    Raises
    ------
    InvalidValueError
        If a wanted time is outside, or the states' times do not increase.
    """
    inside = _inside(times, wanted)
    if len(times) == 1:
        return np.repeat(axes, len(wanted), axis=0)
    known = Rotation.from_matrix(axes)
    spline = RotationSpline(times, known) if method == "cubic" else Slerp(times, known)
    found: FloatArray = spline(inside).as_matrix()
    return found


def _inside(times: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return wanted times (M,), those just outside moved to the ends.

    Raises
    ------
    InvalidValueError
        If one is further outside, or the states' times do not increase.
    """
    if np.any(np.diff(times) <= 0):
        raise InvalidValueError("have times that do not increase", "states")
    slack = 1e-6 if len(times) > 1 else np.inf
    if np.any((wanted < times[0] - slack) | (wanted > times[-1] + slack)):
        raise InvalidValueError(
            f"cover {times[0]:.3f} to {times[-1]:.3f} s, lines run from {wanted.min():.3f} to "
            f"{wanted.max():.3f} s",
            "states",
        )
    return np.clip(wanted, times[0], times[-1])
