"""Heights of a model against the truth, maplet by maplet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.truth.assessment.regions import Ground, PointErrors
from spcola.arrays import BoolArray, FloatArray
from spcola.grids import Maplet, MapletGrid
from spcola.heights.slopes import slopes_of
from spcola.math import Similarity


@dataclass(frozen=True, eq=False)
class PatchErrors:
    """One maplet and the truth on its grid.

    Attributes
    ----------
    maplet : Maplet
        The model, in its own frame.
    truth : (2q+1, 2q+1) ndarray
        Heights of the truth on the same grid, metres.
    points : PointErrors
        Errors of the points that both contain.
    """

    maplet: Maplet
    truth: FloatArray
    points: PointErrors

    @property
    def error(self) -> FloatArray:
        """Height errors (2q+1, 2q+1), model minus truth, metres; NaN where either is unknown."""
        error: FloatArray = self.maplet.height - self.truth
        return error

    @property
    def rms(self) -> float:
        """Root mean square of the height errors, metres; NaN if there are none."""
        heights = self.points.height
        return float(np.sqrt(np.mean(heights**2))) if len(heights) else float("nan")


def patch_errors(maplet: Maplet, ground: Ground, to_model: Similarity) -> PatchErrors:
    """Compare one maplet with the truth.

    Parameters
    ----------
    maplet : Maplet
        In the model's frame.
    ground : Ground
        The truth, in the body's own frame.
    to_model : Similarity
        From the body's frame to the model's: the planted similarity, or the identity. It
        transforms the truth to the maplet's grid, so that planted scale, rotation and
        translation do not count as errors of heights.
    """
    grid, back = maplet.grid, to_model.inverse()
    true_grid = MapletGrid(
        back.apply(grid.center), back.turn(grid.axes), grid.gsd * back.scale, grid.half_size
    )
    true_height = ground.truth.heights_near(true_grid, maplet.height / to_model.scale)
    truth = to_model.scale * true_height
    known = maplet.valid & np.isfinite(truth)
    places = true_grid.points(true_height)[known]
    points = PointErrors(
        (maplet.height - truth)[known].astype(np.float32),
        _angle(maplet.height, truth, grid.gsd)[known].astype(np.float32),
        _stated_sigma(maplet)[known].astype(np.float32),
        (places / np.linalg.norm(places, axis=1, keepdims=True)).astype(np.float32),
        ground.regions(places),
    )
    return PatchErrors(maplet, truth, points)


def _angle(model: FloatArray, truth: FloatArray, gsd: float) -> FloatArray:
    """Return the angles (R, C) between the normals of two surfaces, radians.

    Slopes are central differences over two steps; points at edges and gaps have none.
    """
    normals = []
    for height in (model, truth):
        slope_x, slope_y = slopes_of(height, gsd)
        normals.append(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))
    one, other = normals
    across = np.linalg.norm(np.cross(one, other), axis=-1)
    angle = np.arctan2(across, np.sum(one * other, axis=-1))
    return np.where(_surrounded(model) & _surrounded(truth), angle, np.nan)


def _surrounded(height: FloatArray) -> BoolArray:
    """Return where all four neighbours are known."""
    known = np.pad(np.isfinite(height), 1)
    inside: BoolArray = known[:-2, 1:-1] & known[2:, 1:-1] & known[1:-1, :-2] & known[1:-1, 2:]
    return inside


def _stated_sigma(maplet: Maplet) -> FloatArray:
    """Return the stated sigmas of the heights (2q+1, 2q+1), metres; NaN where not stated.

    A stated uncertainty of the centre is added: displacing the surface by D changes its height
    by D·(Uz − ∂h/∂x Ux − ∂h/∂y Uy).
    """
    if not np.isfinite(maplet.center_sigma).all() or not maplet.center_sigma.any():
        return maplet.sigma
    slope_x, slope_y = slopes_of(maplet.height, maplet.grid.gsd)
    partials = np.nan_to_num(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))
    shared = (partials @ maplet.grid.axes) ** 2 @ maplet.center_sigma**2
    sigma: FloatArray = np.sqrt(maplet.sigma**2 + shared)
    return sigma
