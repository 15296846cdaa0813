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
from spcola.grids.statistics import independent_patches
from spcola.math import Affine


@dataclass(frozen=True, eq=False)
class SurfaceSays:
    """What one surface says about a transform.

    Attributes
    ----------
    equations : Equations
        With all the surface as one cluster.
    area : float
        Cells over which its errors hold together.
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
) -> SurfaceSays | None:
    """Return what one surface says about a transform; None if hardly covered.

    Parameters
    ----------
    returns : CloudOfReturns
    fixed : FixedSurface
    transform : Affine
        Where the partials are taken.
    about : (3,) ndarray
        Lidar coordinates; where rotation and scale act.
    size : {6, 7, 12}
        Number of parameters.
    min_coverage : float
        Share of the grid points that must be compared.
    """
    lidar = height_of_returns(returns, fixed, transform)
    if np.isfinite(lidar.height).mean() < max(min_coverage, 30.0 / lidar.height.size):
        return None
    pair = compared(lidar, fixed)
    whole = len(pair.fixed)
    equations = pair_equations(pair, fixed.grid, transform, about, size=size, block=whole)
    difference = pair.fixed - pair.moving
    area = float(np.isfinite(difference).sum() / independent_patches(difference))
    return SurfaceSays(equations, area, len(returns))
