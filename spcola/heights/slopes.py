"""Conversion between heights, slopes at grid points and steps between neighbours."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray, check_shape

__all__ = ["STEP_SIGMA_FACTOR", "slopes_of", "steps_from_slopes"]

STEP_SIGMA_FACTOR = 2.0
"""Factor on the standard deviation of steps that are read from a smooth surface: where the ground
bends, the four steps at a point have the same error and count as one. Without this factor relief of
some six cells is flattened by more than its sigma."""


def slopes_of(height: FloatArray, gsd: float) -> tuple[FloatArray, FloatArray]:
    """Return the slopes of a surface at its grid points.

    Central differences; one-sided where only one neighbour is known.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres; NaN where unknown.
    gsd : float
        Grid spacing, metres.

    Returns
    -------
    slope_x, slope_y : (R, C) ndarrays
        ∂h/∂x (along columns) and ∂h/∂y (along rows), dimensionless; NaN at unknown points and
        where no neighbour is known in that direction.
    """
    values = np.asarray(height, dtype=np.float64)
    check_shape(values, (None, None), "height")
    slope_y = _slope_along_rows(values) / gsd
    return _slope_along_rows(values.T).T / gsd, slope_y


def steps_from_slopes(
    slope_x: FloatArray, slope_y: FloatArray, gsd: float
) -> tuple[FloatArray, FloatArray]:
    """Return the height steps between neighbours: the mean slope of both (Gaskell et al., eq. 22).

    Parameters
    ----------
    slope_x, slope_y : (R, C) ndarrays
        ∂h/∂x and ∂h/∂y at the grid points, dimensionless; NaN where unknown.
    gsd : float
        Grid spacing, metres.

    Returns
    -------
    step_x : (R, C − 1) ndarray
    step_y : (R − 1, C) ndarray
        Metres; NaN next to a point of unknown slope.
    """
    step_x = 0.5 * gsd * (slope_x[:, 1:] + slope_x[:, :-1])
    step_y = 0.5 * gsd * (slope_y[1:] + slope_y[:-1])
    return step_x, step_y


def _slope_along_rows(values: FloatArray) -> FloatArray:
    """Difference of `values` along the first axis per step, central where both sides are known."""
    ahead = np.full(values.shape, np.nan)
    ahead[:-1] = values[1:] - values[:-1]
    behind = np.full(values.shape, np.nan)
    behind[1:] = ahead[:-1]
    one_sided = np.where(np.isnan(ahead), behind, ahead)
    return np.where(np.isnan(ahead) | np.isnan(behind), one_sided, 0.5 * (ahead + behind))
