"""Nuisance parameters of images: what is known of them, and their changes in a round."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage
from spcola.control.estimation import shift_covariance
from spcola.photometry.photoclinometry.cell_pixels import NUISANCES, WITH_CONTRAST
from spcola.photometry.photoclinometry.image_equations import ImageState
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions

# Most change of ln λ, of its gradient and of a shift (px) in a round: beyond, brightness is not
# linear in the latter.
_MOST = np.array([0.5, 0.5, 0.5, 1.0, 1.0])
# Prior information on ln λ: far below that of a single pixel, so that λ without any stays.
_FREE = 1e-6


def nuisance_priors(
    images: Sequence[SpcImage],
    states: Mapping[str, FloatArray],
    place: FloatArray,
    options: PhotoclinometryOptions,
) -> FloatArray:
    """Return the prior information (K, 5, 5) on the nuisance parameters of K images about 0.

    Parameters
    ----------
    images : sequence of SpcImage
    states : mapping of str to (6, 6) ndarray
        Covariances of their states: how far each image may be shifted.
    place : (3,) ndarray
        On the ground, body-fixed, metres.
    options : PhotoclinometryOptions
    """
    known = np.zeros((len(images), NUISANCES, NUISANCES))
    known[:] = np.diag([_FREE, *[options.gradient_sigma**-2] * 2, 0.0, 0.0])
    for one, image in zip(known, images, strict=True):
        covariance = shift_covariance(image, states[image.name], place)
        # A camera that looks away shows nothing, and is not shifted.
        covariance = np.where(np.isfinite(covariance), covariance, 0.0)
        one[3:, 3:] = np.linalg.inv(covariance + options.shift_sigma_px**2 * np.eye(2))
    return known


def with_contrast(
    before: FloatArray, known: FloatArray, sigma: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return nuisance parameters and priors with those of the contrast, and where the latter are.

    Parameters
    ----------
    before, known : (K, 5), (K, 5, 5) ndarrays
        Values of nuisance parameters, and prior information on them.
    sigma : float
        Standard deviation of the errors of contrast.

    Returns
    -------
    (K, 6) ndarray, (K, 6, 6) ndarray, (6 K,) ndarray of bool
    """
    values = np.pad(before, ((0, 0), (0, 1)))
    priors = np.pad(known, ((0, 0), (0, 1), (0, 1)))
    priors[:, NUISANCES, NUISANCES] = sigma**-2
    return values, priors, np.tile(np.arange(WITH_CONTRAST) == NUISANCES, len(before))


def nuisance_values(states: Sequence[ImageState]) -> FloatArray:
    """Return the nuisance parameters (K, 5) of images as their priors refer to them."""
    return np.array([[0.0, *one.gradient, *one.shift] for one in states]).reshape(-1, NUISANCES)


def shift_ratio(states: Sequence[ImageState], known: FloatArray) -> float:
    """Return the median over K images of their shifts in sigmas, an axis; NaN without images.

    `known` (K, 5, 5) is the prior information on their nuisance parameters.
    """
    squares = [
        0.5 * float(one.shift @ prior[3:, 3:] @ one.shift)
        for one, prior in zip(states, known, strict=True)
    ]
    return float(np.sqrt(np.median(squares))) if squares else float("nan")


def changed_state(state: ImageState, step: FloatArray) -> ImageState:
    """Return the state of an image after a step (5,) of its nuisance parameters, bounded."""
    bounded = np.clip(step, -_MOST, _MOST)
    return replace(
        state,
        scale=state.scale * float(np.exp(bounded[0])),
        gradient=state.gradient + bounded[1:3],
        shift=state.shift + bounded[3:],
    )
