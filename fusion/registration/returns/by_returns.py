"""The normal equations of a transform from the returns on one SPC surface, without a mapola."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.registration.returns.equations import Equations, pair_equations
from fusion.registration.returns.return_heights import (
    CloudOfReturns,
    FixedSurface,
    compared,
    height_of_returns,
)
from spcola.arrays import FloatArray
from spcola.grids.correlation import independent_patches
from spcola.math import Affine


@dataclass(frozen=True, eq=False)
class SurfaceNormalEquations:
    """Contribution of one surface to the normal equations of a transform.

    Attributes
    ----------
    equations : Equations
        With the whole surface as one cluster.
    area : float
        Correlation area of its errors, cells.
    returns : int
    """

    equations: Equations
    area: float
    returns: int


def surface_equations(
    returns: CloudOfReturns,
    fixed: FixedSurface,
    transform: Affine,
    about: FloatArray,
    *,
    size: int,
    min_coverage: float,
) -> SurfaceNormalEquations | None:
    """Return one surface's normal equations of a transform; None if it is hardly covered.

    Parameters
    ----------
    returns : CloudOfReturns
    fixed : FixedSurface
    transform : Affine
        Transform at which the partials are evaluated.
    about : (3,) ndarray
        Centre of rotation and scale, lidar coordinates, metres.
    size : {6, 7, 12}
        Number of parameters.
    min_coverage : float
        Smallest share of grid points with returns.
    """
    lidar = height_of_returns(returns, fixed, transform)
    if np.isfinite(lidar.height).mean() < max(min_coverage, 30.0 / lidar.height.size):
        return None
    pair = compared(lidar, fixed)
    whole = len(pair.fixed)
    equations = pair_equations(pair, fixed.grid, transform, about, size=size, block=whole)
    difference = pair.fixed - pair.moving
    area = float(np.isfinite(difference).sum() / independent_patches(difference))
    return SurfaceNormalEquations(equations, area, len(returns))
