"""What errors of the slopes of the ground do to a fit of a photometric function.

A slope error changes the brightness of its ground by the gradient of Φ over directions of the
normal. Errors that differ from place to place scatter the residuals, and clustered scores contain
them. But solved relief is smoothed, steep faces are flattened, and a mean over slopes that are
wrong is not that over the true ones: a share of the change has the same sign at all places in the
same light and view. No scatter shows that share. It is taken as a smooth function of phase,
incidence and emission, of unknown coefficients.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from spcola.arrays import FloatArray
from spcola.photometry.fitting.samples import PhotometricSamples
from spcola.photometry.functions import PhotometricFunction

# Share of the brightness errors by slopes that is common to all places in one light and view.
_COMMON = 0.25
# Angle over which that share changes by itself, radians.
_CHANGE = np.radians(30.0)
# Residuals count up to this many standard deviations, and the mean of normal ones squared then.
_CLIP, _CLIPPED = 2.5, 0.978
_ROUNDS = 10
# Smallest variance of a residual, relative brightness: below the rounding of any image.
_LEAST = 1e-12


def slope_response(samples: PhotometricSamples, function: PhotometricFunction) -> FloatArray:
    """Return by how much brightness over λ (N,) changes with a slope of 1 radian: rms in a block.

    Of all directions in which the normal may tilt, the steepest: |∇Φ| on the sphere of normals.

    Parameters
    ----------
    samples : PhotometricSamples
    function : PhotometricFunction
    """
    light, view = samples.cosines
    found = function.partials(light, view, samples.phase)
    by_light, by_view = found.by_cos_incidence, found.by_cos_emission
    square = by_light**2 * (1.0 - light**2) + by_view**2 * (1.0 - view**2)
    square += 2.0 * by_light * by_view * (np.cos(samples.phase) - light * view)
    albedo = samples.means(np.ones_like(light))
    response: FloatArray = np.sqrt(albedo * np.maximum(samples.means(square), 0.0))
    return response


def slope_error(residual: FloatArray, fitted: FloatArray, response: FloatArray) -> float:
    """Return the error of the slopes of blocks, radians (1 σ), of which residuals scatter.

    Their variance is that of noise, equal for all, of albedo, as the square of the brightness, and
    of slopes, as the square of the response: by least squares, none of them negative.

    Parameters
    ----------
    residual, fitted, response : (N,) ndarrays
        Observed minus fitted brightness, fitted brightness, and its change by a slope.
    """
    parts = np.stack([np.ones_like(fitted), fitted**2, response**2], axis=1)
    square = residual**2
    variance = np.full(fitted.shape, max(float(np.median(square)), _LEAST))
    sizes = np.zeros(3)
    for _ in range(_ROUNDS):
        clipped = np.minimum(square, _CLIP**2 * variance) / _CLIPPED
        sizes, _ = nnls(parts / variance[:, None], clipped / variance)
        variance = np.maximum(parts @ sizes, _LEAST)
    return float(np.sqrt(sizes[2]))


def common_errors(
    samples: PhotometricSamples, response: FloatArray, slope_sigma: float
) -> FloatArray:
    """Return errors of brightness (4, N) that are common to all places, each 1 σ.

    One is the same share of the change by a slope error everywhere; in the others it changes with
    phase, incidence and emission.

    Parameters
    ----------
    samples : PhotometricSamples
    response : (N,) ndarray
        Change of the brightness by a slope of 1 radian.
    slope_sigma : float
        Error of the slopes of blocks, radians.
    """
    angles = np.stack([samples.phase, *np.arccos(samples.cosines)])
    cells = np.diff(samples.start, append=samples.phase.size)
    angle = np.add.reduceat(angles, samples.start, axis=-1) / cells
    change = (angle - angle.mean(axis=1, keepdims=True)) / _CHANGE
    shapes: FloatArray = np.vstack([np.ones_like(response), change])
    return _COMMON * slope_sigma * response * shapes
