"""Covariance of the state of an image: position and pointing together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray
from spcola.camera import SpcImage, partials_position, project_image
from spcola.control.estimation.landmark_fit import solve_state, state_partials
from spcola.errors import NotObservableError
from spcola.math.robust import mad

# Smallest sigma of landmarks of an SPC solution in images, pixels, even if few show less.
_LEAST_PX = 0.1


@dataclass(frozen=True, eq=False)
class MeasuredLandmarks:
    """Landmarks that determine the state of an image.

    Parameters
    ----------
    points : (N, 3) ndarray
        V of each, body-fixed, metres.
    observed : (N, 2) ndarray
        Pixel and line.
    sigma : (N, 3) ndarray
        One standard deviation of V, metres; NaN if not known.
    """

    points: FloatArray
    observed: FloatArray
    sigma: FloatArray

    def residuals(self, image: SpcImage) -> FloatArray:
        """Observed pixel and line (N, 2) less those predicted by the state of `image`."""
        return self.observed - np.stack(project_image(image, self.points), axis=1)

    def landmark_variance(self, image: SpcImage) -> FloatArray:
        """Variance (N, 2), pixels², of pixel and line in `image` by the errors of the landmarks."""
        partials = partials_position(image, self.points)
        return np.sum((partials * np.nan_to_num(self.sigma)[:, None, :]) ** 2, axis=2)


def measured_sigma(images: list[tuple[SpcImage, MeasuredLandmarks]]) -> float:
    """Return one standard deviation of measured landmarks, pixels, without their own errors.

    `images` are pairs of an image and its measured landmarks.

    From the median deviation of all residuals; a tenth of a pixel at least. Landmarks behind the
    camera, by a wrong state, do not count.
    """
    if not images:
        return _LEAST_PX
    residuals = np.concatenate([fixes.residuals(image).ravel() for image, fixes in images])
    variances = np.concatenate([fixes.landmark_variance(image).ravel() for image, fixes in images])
    known = np.isfinite(residuals) & np.isfinite(variances)
    if not known.any():
        return _LEAST_PX
    left = float(mad(residuals[known])) ** 2 - float(np.median(variances[known]))
    return float(np.sqrt(max(left, _LEAST_PX**2)))


def state_covariance(
    image: SpcImage, anchor: ArrayLike, fixes: MeasuredLandmarks, *, sigma_px: float
) -> FloatArray:
    """Return the covariance (6, 6) of (τ1, τ2, τ3, V0), radians and metres [13, 14].

    The solution has turned the camera until its ground fits: the position is known to its stated
    sigma, the ground in the middle of the image and the roll to the stated sigma of pointing, and
    the landmarks in the image determine the rest. Independent sigmas of position and pointing
    would assign both errors to the ground.

    Parameters
    ----------
    image : SpcImage
        Its stated sigmas are used.
    anchor : (3,) array_like
        Ground in the middle of the image, body-fixed, metres.
    fixes : MeasuredLandmarks
        May be empty.
    sigma_px : float
        One standard deviation of a measured landmark, pixels.

    Raises
    ------
    NotObservableError
        If the image states no sigmas and has too few landmarks.
    """
    turns = image.pointing_sigma
    anchor_sigma = float(np.sqrt(np.mean(turns[:2] ** 2))) / image.camera.pixel_angle
    # By a wrong state landmarks may lie behind the camera: they determine nothing.
    ahead = np.isfinite(fixes.residuals(image)).all(axis=1)
    points, observed, spread = fixes.points[ahead], fixes.observed[ahead], fixes.sigma[ahead]
    noise = np.full(len(points), sigma_px)
    middle = np.array(project_image(image, anchor))
    if np.isfinite(anchor_sigma) and anchor_sigma > 0 and np.isfinite(middle).all():
        points = np.concatenate([points, np.reshape(anchor, (1, 3))])
        observed = np.concatenate([observed, middle[None]])
        noise = np.append(noise, anchor_sigma)
        spread = np.concatenate([spread, np.zeros((1, 3))])
    if not len(points):
        raise NotObservableError("states no sigma, and has no landmarks", (), where=image.name)
    stated = replace(image, pointing_sigma=np.array([np.nan, np.nan, turns[2]]))
    return solve_state(stated, points, observed, noise, landmark_sigma=spread).covariance


def shift_covariance(image: SpcImage, covariance: FloatArray, point: ArrayLike) -> FloatArray:
    """Return the covariance (2, 2), pixels², of the place of ground in an image by its state.

    Parameters
    ----------
    image : SpcImage
    covariance : (6, 6) ndarray
        Of its state, as :func:`state_covariance`.
    point : (3,) array_like
        Body-fixed, metres.
    """
    partials = state_partials(image, point)
    placed: FloatArray = partials @ covariance @ partials.T
    return placed


def by_position_and_pointing(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split covariances (…, 6, 6) of states into errors of position, and of pointing.

    Returns
    -------
    position, pointing : (…, 6, 6) ndarrays
        Errors of the position with the correlated turn of the camera, and the remaining error of
        the pointing at a known position. Their sum is `covariance`.
    """
    crossed, placed = covariance[..., :3, 3:], covariance[..., 3:, 3:]
    along = crossed @ np.linalg.inv(placed) @ np.swapaxes(crossed, -1, -2)
    position, pointing = covariance.copy(), np.zeros_like(covariance)
    position[..., :3, :3] = along
    pointing[..., :3, :3] = covariance[..., :3, :3] - along
    return position, pointing
