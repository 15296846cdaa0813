"""Landmarks of the synthetic solution: their images, places in them, and overlaps."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import ImagePoint, SpcImage, project_image
from spcola.control import Landmark, overlaps_of
from spcola.grids import MapletGrid
from spcola.truth.campaign.states import SolvedState, StateSettings
from spcola.truth.sampled.sampled_surface import SampledSurface

_PRIOR_SIGMA = 5.0


class SolvedCenter(Protocol):
    """The centre of a maplet of the solution, without its heights."""

    @property
    def name(self) -> str:
        """Name of the landmark."""

    @property
    def grid(self) -> MapletGrid:
        """In the frame of the solution."""

    @property
    def center_sigma(self) -> FloatArray:
        """One standard deviation of the centre (3,), metres."""

    @property
    def true_center(self) -> FloatArray:
        """Centre (3,), metres, in the body frame, without the error of the solution."""


def measure_landmarks(
    state: SolvedState,
    solved_centers: Sequence[SolvedCenter],
    surface: SampledSurface,
    *,
    settings: StateSettings,
    generator: np.random.Generator,
) -> tuple[ImagePoint, ...]:
    """Return the landmarks in an image, with their places.

    The true centre is projected through the true state, with noise: the prediction from the
    solution's centres and states differs by their errors. A landmark is measured if it is in the
    frame, large enough, faces camera and Sun, and is neither occluded nor in shadow.

    Parameters
    ----------
    state : SolvedState
    solved_centers : sequence of SolvedCenter
    surface : SampledSurface
        Sampled surface of the true body.
    settings : StateSettings
    generator : numpy.random.Generator
        The number of random numbers used does not depend on visibility.

    Returns
    -------
    tuple of ImagePoint
        In the order of the maplets; pixel and line with two decimals, as in the files.
    """
    image = state.truth
    centers = np.array([solved.true_center for solved in solved_centers]).reshape(-1, 3)
    noise = settings.pixel_sigma * generator.normal(size=(2, len(centers)))
    # Two decimals, so that .LMK and .SUM agree.
    measured = np.round(np.stack(project_image(image, centers)) + noise, 2)
    seen = _in_frame(image, measured) & _facing(state, solved_centers, settings)
    seen &= _resolved(image, centers, solved_centers, settings)
    for way in (image.position - centers, np.broadcast_to(image.sun, centers.shape)):
        candidates = np.flatnonzero(seen)
        hidden = surface.occluded(centers[candidates], way[candidates])
        seen[candidates[hidden]] = False
    return tuple(
        ImagePoint(solved_centers[k].name, float(measured[0, k]), float(measured[1, k]))
        for k in np.flatnonzero(seen).tolist()
    )


def landmarks_of(
    centers: Sequence[SolvedCenter], images: Sequence[SpcImage], *, rms: float
) -> list[Landmark]:
    """Return the landmarks of all maplets: pictures as listed by the images, and overlaps.

    Parameters
    ----------
    centers : sequence of SolvedCenter
    images : sequence of SpcImage
        With their landmarks; each landmark's pictures follow their order.
    rms : float
        RMSLMK of all landmarks.
    """
    pictures: dict[str, list[ImagePoint]] = defaultdict(list)
    for image in images:
        for point in image.landmarks:
            pictures[point.name].append(ImagePoint(image.name, point.pixel, point.line))
    overlaps_of_all = overlaps_of({center.name: center.grid for center in centers})
    return [
        Landmark(
            center.name,
            center.grid,
            sigma=center.center_sigma,
            prior_sigma=_PRIOR_SIGMA,
            rms=rms,
            pictures=tuple(pictures[center.name]),
            overlaps=overlaps,
        )
        for center, overlaps in zip(centers, overlaps_of_all, strict=True)
    ]


def _in_frame(image: SpcImage, measured: FloatArray) -> BoolArray:
    """Return which measured pixels and lines (2, N) lie in the frame; NaN do not."""
    size = np.array([[image.camera.width], [image.camera.height]])
    return np.all((measured > 1.0) & (measured < size), axis=0)


def _facing(
    state: SolvedState, solved_centers: Sequence[SolvedCenter], settings: StateSettings
) -> BoolArray:
    """Return which maplets (N,) face the camera and the Sun, by the solution's own geometry."""
    grids = [solved.grid for solved in solved_centers]
    normals = np.array([grid.uz for grid in grids]).reshape(-1, 3)
    toward = state.solved.position - np.array([grid.center for grid in grids]).reshape(-1, 3)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    facing = np.sum(normals * toward, axis=1) > np.cos(np.radians(settings.most_emission_deg))
    lit = normals @ state.solved.sun > np.cos(np.radians(settings.most_incidence_deg))
    return facing & lit


def _resolved(
    image: SpcImage,
    centers: FloatArray,
    solved_centers: Sequence[SolvedCenter],
    settings: StateSettings,
) -> BoolArray:
    """Return for which maplets (N,) the pixels are fine enough."""
    gsd = np.array([solved.grid.gsd for solved in solved_centers])
    pixel = image.camera.pixel_angle * np.linalg.norm(image.position - centers, axis=1)
    return pixel <= settings.coarsest * gsd
