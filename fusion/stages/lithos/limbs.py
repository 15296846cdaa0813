"""Limbs in images as constraining heights."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fusion.stages.lithos.returns import above, supported
from fusion.stages.register import ImageScene
from spcola.arrays import FloatArray
from spcola.camera import SpcImage, partials_position
from spcola.control.estimation import shift_covariance
from spcola.grids import Maplet
from spcola.imagematching.limbs import LimbPoints, find_limb
from spcola.photometry.photoclinometry import HeightConstraint

# A limb lies on ground seen at an emission whose cosine is at most this, and determines its height
# where the cosine of its normal and Uz is at least `_STEEPEST`.
_GRAZING, _STEEPEST = 0.6, 0.5
# One standard deviation of the error that the limb of an image has in common, pixels: relief along
# the line of sight raises it, blur and shading displace it.
_COMMON_PX = 0.2


@dataclass(frozen=True, eq=False)
class Limbs:
    """The limbs of the shape in all images; each image is looked at once.

    Parameters
    ----------
    images : ImageScene
        With a shape.
    reach_m : float
        How far a limb may lie from the shape's, metres.
    found : dict of str to LimbPoints
        Limbs by image, as far as they have been asked for.
    """

    images: ImageScene
    reach_m: float
    found: dict[str, LimbPoints] = field(default_factory=dict)

    def of(self, image: SpcImage) -> LimbPoints:
        """Return the limb in an image of the scene."""
        if image.name not in self.found:
            assert self.images.beyond is not None
            exposed = self.images.exposed(image)
            self.found[image.name] = find_limb(exposed, self.images.beyond, reach_m=self.reach_m)
        return self.found[image.name]

    def constraint(self, start: Maplet, slope_sigma: float) -> HeightConstraint | None:
        """Return the heights of limbs on the grid of a maplet; None if there are none.

        The error of an image's state along its limb is common to its points.

        Parameters
        ----------
        start : Maplet
            Heights known so far.
        slope_sigma : float
            Of the slopes of these.
        """
        limbs = [self._on(start, image) for image in self.images.images]
        seen = [limb for limb in limbs if limb is not None]
        if not seen:
            return None
        place, sigma = (np.concatenate([limb[k] for limb in seen]) for k in (0, 1))
        group = np.repeat(np.arange(len(seen)), [len(limb[0]) for limb in seen])
        common = [limb[2] for limb in seen]
        kept = supported(place, sigma, above(start, place), slope_sigma, start.grid)
        constraint = HeightConstraint.of_points(
            "limbs", start.grid, place[kept], sigma[kept], group[kept], np.diag(common)
        )
        return replace(constraint, left_out=int(np.sum(~kept)))

    def _on(self, start: Maplet, image: SpcImage) -> tuple[FloatArray, FloatArray, float] | None:
        """Return places (N, 3) on the grid, their sigmas, and the variance that they share."""
        grid = start.grid
        away = image.position - grid.center
        if abs(away @ grid.uz) > _GRAZING * np.linalg.norm(away):
            return None
        limb = self.of(image)
        place = (limb.points - grid.center) @ grid.axes.T
        upward = limb.normals @ grid.uz
        half = grid.half_size * grid.gsd
        within = (np.abs(place) <= [half, half, grid.radius]).all(axis=1) & (upward > _STEEPEST)
        if not within.any():
            return None
        place, upward, normal = place[within], upward[within], limb.normals[within].mean(axis=0)
        across = partials_position(image, grid.center) @ normal
        pixels_a_metre = float(np.linalg.norm(across))
        state = shift_covariance(image, self.images.states[image.name], grid.center)
        shift = float(across @ state @ across) / pixels_a_metre**2 + _COMMON_PX**2
        shared = shift / (pixels_a_metre * float(upward.mean())) ** 2
        return place, limb.sigma[within] / upward, shared
