"""Energy (A) of one maplet: height steps and heights of SPC, lidar and shape, with weights.

Source: docs, derivations §15.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from fusion.fusing.constraints import Constraints
from fusion.fusing.fuse_input import FuseInput, FuseOptions
from fusion.fusing.uncertainty import ShapeErrors, SlopeInformation
from fusion.fusing.uncertainty.spc_errors import along_edges, light_along_edges
from spcola.arrays import BoolArray, FloatArray
from spcola.grids.bending import bending
from spcola.grids.gaps import carried_on, filled, plane_of
from spcola.heights import HeightProblem
from spcola.heights.slopes import STEP_SIGMA_FACTOR
from spcola.math.robust import cauchy_weight


def height_problem(
    parts: FuseInput,
    lidar: Constraints,
    information: SlopeInformation,
    shape: ShapeErrors,
    options: FuseOptions,
) -> HeightProblem:
    """Return energy (A) of one maplet: height steps, constraining heights, and their weights.

    Parameters
    ----------
    parts : FuseInput
    lidar : Constraints
        The heights of ``parts.lidar`` that are used.
    information : SlopeInformation
        Errors of SPC.
    shape : ShapeErrors
    options : FuseOptions
    """
    valid, gsd = parts.spc.valid, parts.grid.gsd
    mask = valid | lidar.known | np.isfinite(parts.prior)
    known = np.where(valid, parts.spc.height, 0.0)
    surface = _shape_surface(parts, lidar)
    ground = _ground(parts, lidar, surface)
    noise = np.nan_to_num(lidar.sigma)
    bent = np.abs(np.nan_to_num(bending(ground)))
    steps, weights = [], []
    for axis in (1, 0):
        imaged = _both(valid, axis)
        step = np.where(imaged, np.diff(known, axis=axis), np.diff(surface, axis=axis))
        # SPC errors grow with slope, and SPC underestimates steep slopes: the larger of its slope
        # and the lidar's is used.
        ground_step = np.diff(ground, axis=axis)
        slope = np.maximum(np.abs(step), np.abs(ground_step)) / gsd
        bend = along_edges(bent, axis)
        light = None if parts.light is None else light_along_edges(parts.light, 1, axis)
        sigma = information.step_sigma(slope, bend, gsd, light)
        sigma = np.where(imaged, sigma, shape.step_sigma_m)
        # The flank of a boulder that SPC or the shape lacks is an outlier among the errors of
        # steps: with full weight the step would flatten the flank.
        measured = _both(np.isfinite(lidar.height), axis)
        spread = np.hypot(sigma, along_edges(noise, axis))
        contradicted = np.where(imaged | measured, (ground_step - step) / spread, 0.0)
        trust = cauchy_weight(contradicted, options.step_loss_scale)
        # SPC rounds what the lidar resolves.
        trust = np.where(imaged & measured, trust / STEP_SIGMA_FACTOR**2, trust)
        steps.append(step)
        weights.append(np.where(_both(mask, axis), trust / sigma**2, 0.0))
    height, weight = _heights(parts, lidar, information, shape)
    return HeightProblem(
        steps[0], steps[1], weights[0], weights[1], height, weight, mask, lidar.means
    )


def _shape_surface(parts: FuseInput, lidar: Constraints) -> FloatArray:
    """Heights of the shape with gaps filled; of a plane if there is no shape."""
    if np.isfinite(parts.prior).any():
        return filled(parts.prior)
    return plane_of(np.where(np.isfinite(lidar.height), lidar.height, parts.spc.height))


def _ground(parts: FuseInput, lidar: Constraints, surface: FloatArray) -> FloatArray:
    """Approximate ground, for the weights of steps: lidar, else SPC, else the shape.

    Each is corrected by its nearest difference from the preceding one, so that there is no
    artificial step between them. A plane through the differences would be tilted by noise if the
    lidar is a single track.
    """
    spc = parts.spc.height + np.nan_to_num(carried_on(lidar.height - parts.spc.height))
    known = np.where(np.isfinite(lidar.height), lidar.height, spc)
    if lidar.coarse is not None:
        known = np.where(np.isfinite(known), known, lidar.coarse)
    bent = surface + np.nan_to_num(carried_on(known - surface))
    # An outlier is one cell wide, a boulder is wider: the median removes outliers, which would
    # otherwise reduce the weights of the steps around them.
    return ndimage.median_filter(bent, size=3, mode="nearest")


def _both(mask: BoolArray, axis: int) -> BoolArray:
    """Mask of the edges along `axis` that have both ends in `mask`."""
    count = mask.shape[axis]
    return np.take(mask, range(1, count), axis) & np.take(mask, range(count - 1), axis)


def _heights(
    parts: FuseInput, lidar: Constraints, information: SlopeInformation, shape: ShapeErrors
) -> tuple[FloatArray, FloatArray]:
    """Constraining heights and weights: of the lidar, else of the maplet, else of the shape."""
    own = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, information.height_sigma_m)
    own = np.hypot(own, _center_sigma(parts))
    valid = parts.spc.valid
    height = np.where(valid, parts.spc.height, parts.prior)
    one = shape.height_sigma_m * np.sqrt(shape.correlated_cells)
    sigma = np.where(valid, own * np.sqrt(information.correlated_cells), one)
    with_lidar = np.isfinite(lidar.height)
    height = np.where(with_lidar, lidar.height, height)
    sigma = np.where(with_lidar, lidar.sigma, sigma)
    weight = np.where(np.isfinite(height), 1.0 / np.maximum(sigma, 1e-6) ** 2, 0.0)
    return height, weight


def _center_sigma(parts: FuseInput) -> float:
    """Sigma of the maplet's centre along Uz, metres; 0 where the file has none."""
    along = parts.grid.uz**2 @ np.nan_to_num(parts.spc.center_sigma) ** 2
    return float(np.sqrt(along))
