"""Photoclinometry of photographs of waves in known states, and how wrong its slopes are."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from photographs import Waves

from spcola.camera import SpcImage
from spcola.grids import Maplet
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import (
    HeightConstraint,
    Photoclinometry,
    PhotoclinometryOptions,
    solve_photoclinometry,
)
from spcola.photometry.photoclinometry.surface import cell_slopes

# Directions to camera and Sun.
SIGHTS = [
    ([0.3, 0.0, 1.0], [0.7, 0.1, 0.8]),
    ([-0.4, 0.2, 1.0], [-0.5, 0.4, 0.8]),
    ([0.0, 0.4, 1.0], [0.1, 0.7, 0.8]),
    ([0.1, -0.4, 1.0], [0.2, -0.6, 0.8]),
    ([0.0, 0.0, 1.0], [-0.6, -0.3, 0.8]),
    ([0.4, 0.4, 1.0], [0.5, -0.5, 0.8]),
]
FEW_ROUNDS = PhotoclinometryOptions(function=lambert, least_error=1e-3, settled_gsd=5e-3)
_EDGE = 4


def photographs_of(ground: Waves, size: int = 90) -> list[SpcImage]:
    """Six images of the ground, of so many lines, with pixels of 0.5 m."""
    return [
        ground.photograph(f"I{k}", toward, sun, pixel=0.5, size=size)
        for k, (toward, sun) in enumerate(SIGHTS)
    ]


def solved_flat(
    ground: Waves, images: Iterable[SpcImage], options: PhotoclinometryOptions, **given: Any
) -> Photoclinometry:
    """Solve heights and albedo from a plane, with the height of one point known."""
    grid, images = ground.grid, list(images)
    height = np.full(grid.shape, np.nan)
    middle = (grid.half_size, grid.half_size)
    height[middle] = ground.heights()[middle]
    given = {"constraints": [HeightConstraint.of_sigma("one", height, 1e-3)], **given}
    return solve_photoclinometry(
        Maplet("FLAT", grid, np.zeros(grid.shape)), images,
        {image.name: 1e-14 * np.eye(6) for image in images}, options=options, **given,
    )  # fmt: skip


def slope_error(ground: Waves, found: Photoclinometry) -> float:
    """Root mean square of the errors of the slopes of inner cells."""
    wrong = cell_slopes(found.maplet.height - ground.heights(), ground.grid.gsd)
    return rms(wrong[:, _EDGE:-_EDGE, _EDGE:-_EDGE])


def true_slope(ground: Waves) -> float:
    """Root mean square of the true slopes there."""
    slopes = cell_slopes(ground.heights(), ground.grid.gsd)
    return rms(slopes[:, _EDGE:-_EDGE, _EDGE:-_EDGE])


def rms(values: Any) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
