"""The sigma of fused heights, and that of SPC heights relative to the lidar."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from fusion.fusing.constraints import Constraints
from fusion.fusing.fuse_input import FuseInput
from fusion.fusing.uncertainty import ShapeErrors, SlopeInformation
from spcola.arrays import BoolArray, FloatArray
from spcola.grids import MapletGrid
from spcola.grids.bending import bending
from spcola.heights.slopes import slopes_of


def fused_sigma(
    parts: FuseInput,
    lidar: Constraints,
    information: SlopeInformation,
    shape: ShapeErrors,
    height: FloatArray,
    own: FloatArray,
) -> FloatArray:
    """Standard deviation (R, C), metres, of fused heights: ``σ² = σ_own² + σ_shared²``.

    σ_own is `own`, that of the inverse normal matrix, but far from the lidar at least SPC's and far
    from both at least the shape's. `own` alone would be too small there: independent step errors
    correlate heights over more points than SPC's errors do, so that many SPC heights seem to
    average out. Near the lidar it partly determines SPC's errors: with an exponential correlation
    and lidar on both sides, a share tanh(distance / length) remains.

    σ_shared² = rᵀ Σ r, r = (−∂h/∂x, −∂h/∂y, 1), is the variance by a displacement of the whole
    surface, whose covariance Σ is that of the registered position; far from the lidar that of the
    maplet's centre is added. Source: docs, derivations §15, Sigma.

    Parameters
    ----------
    parts : FuseInput
    lidar : Constraints
        The heights of ``parts.lidar`` that were used.
    information : SlopeInformation
        Errors of SPC.
    shape : ShapeErrors
    height, own : (R, C) ndarrays
        Fused heights, and their sigma by the inverse normal matrix, metres.
    """
    valid = parts.spc.valid
    free = np.where(valid, _free(lidar.known, information.correlated_cells), 0.0)
    spc = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, information.height_sigma_m)
    filled_in = _free(lidar.known | valid, shape.correlated_cells)
    least = np.maximum(free * spc**2, filled_in * shape.height_sigma_m**2)
    center = np.diag(np.nan_to_num(parts.spc.center_sigma) ** 2)
    shared = _displaced_variance(parts.grid, height, parts.common_covariance)
    shared = shared + free * _displaced_variance(parts.grid, height, center)
    return np.sqrt(np.maximum(own**2, least) + shared)


def spc_sigma(parts: FuseInput, information: SlopeInformation) -> FloatArray:
    """Standard deviation (R, C) of SPC heights relative to the lidar's, metres.

    It includes displacements of the whole surface, and what SPC misses on steep or bent ground.
    """
    height, gsd = parts.spc.height, parts.grid.gsd
    own = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, 0.0)
    slope = np.nan_to_num(np.hypot(*slopes_of(height, gsd)))
    bent = np.abs(np.nan_to_num(bending(height)))
    rough = information.step_sigma(slope, bent, gsd)
    center = np.diag(np.nan_to_num(parts.spc.center_sigma) ** 2)
    shared = _displaced_variance(parts.grid, height, center + parts.common_covariance)
    own = np.maximum(own, information.height_sigma_m)
    return np.sqrt(own**2 + rough**2 + shared)


def missing_boulder_sigma(parts: FuseInput) -> FloatArray:
    """Sigma (R, C), metres, that a contradicted lidar height adds: it may be a boulder.

    A boulder that SPC lacks is about one cell wide, and no higher than wide.
    """
    return np.minimum(np.abs(parts.lidar.height - parts.spc.height), parts.grid.gsd)


def _free(known: BoolArray, cells: float) -> FloatArray:
    """Share (0 … 1) of an error correlated over `cells` that remains, given `known` points."""
    if not known.any():
        return np.ones(known.shape)
    away = ndimage.distance_transform_edt(~known)
    free: FloatArray = np.tanh(away / np.sqrt(cells / np.pi))
    return free


def _displaced_variance(grid: MapletGrid, height: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance, m², of the height error caused by a displacement of the whole surface.

    A displacement D changes the height at a point by D_z − ∇h · D_xy. The `covariance` of D is
    body-fixed, m².
    """
    slope_x, slope_y = slopes_of(height, grid.gsd)
    rows = np.nan_to_num(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))
    local = grid.axes @ covariance @ grid.axes.T
    variance: FloatArray = np.einsum("rci,ij,rcj->rc", rows, local, rows)
    return variance
