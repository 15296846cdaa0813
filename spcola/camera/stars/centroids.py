"""Stars in an image: where they are, and how well that is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.special import erf

from spcola.arrays import AnyArray, FloatArray, frozen
from spcola.errors import InvalidValueError
from spcola.math.robust import mad

# A window of 7 × 7 pixels about the brightest one.
_HALF = 3
_STEPS = 50
_CLIPPINGS = 8
_STEP_TOLERANCE = 1e-6
# Widths (pixels) of what is a star's image; a hit by a particle is narrower.
_WIDTHS = (0.25, 3.0)
# Residuals whose variance is larger than the background's by this are more than its chance.
_LARGER = 1.6
# Noise of an image after smoothing with a width of one pixel: 1 / (2 √π).
_SMOOTHED_NOISE = 0.2821


@dataclass(frozen=True, eq=False)
class StarPositions:
    """Measured positions of stars in one image.

    Parameters
    ----------
    pixel, line : (N,) array_like
        From (1, 1) in the middle of the first pixel.
    covariance : (N, 2, 2) array_like
        Of (pixel, line).
    flux : (N,) array_like
        In the image's unit; NaN if unknown.

    Raises
    ------
    InvalidValueError
        If shapes differ or a covariance is not positive definite.
    """

    pixel: FloatArray
    line: FloatArray
    covariance: FloatArray
    flux: FloatArray

    def __post_init__(self) -> None:
        pixel = frozen(self.pixel, (None,), "stars: pixel")
        count = len(pixel)
        object.__setattr__(self, "pixel", pixel)
        for name, shape in (("line", (count,)), ("covariance", (count, 2, 2)), ("flux", (count,))):
            object.__setattr__(self, name, frozen(getattr(self, name), shape, f"stars: {name}"))
        if not np.all(np.isfinite(self.covariance)) or np.any(
            np.linalg.eigvalsh(self.covariance) <= 0
        ):
            raise InvalidValueError("has a covariance that is not positive definite", "stars")

    def __len__(self) -> int:
        return len(self.pixel)


# Least height of the smoothed image above the background, in its standard deviations.
_THRESHOLD = 6.0


def find_stars(pixels: AnyArray, *, saturation: float = np.inf) -> StarPositions:
    """Find stars in an image and fit each by a Gaussian integrated over pixels.

    Amplitude, place, width and background of each are fitted to 7 × 7 pixels. The covariance is
    that of the fit with the noise of the image's background, or of the window's residuals where
    they are clearly larger (a bright star's shot noise, an image that is no Gaussian).

    Parameters
    ----------
    pixels : (H, W) ndarray
        Brightness; NaN where unknown.
    saturation : float
        Brightness from which on a pixel is saturated; such stars are left out.

    Raises
    ------
    InvalidValueError
        If the image is smaller than the window, or has no noise.
    """
    image = np.asarray(pixels, dtype=np.float64)
    if image.ndim != 2 or min(image.shape) < 2 * _HALF + 1:
        raise InvalidValueError(
            f"has shape {image.shape}, 7 × 7 pixels at least are needed", "image"
        )
    background, noise = _background(image[np.isfinite(image)])
    if not noise > 0:
        raise InvalidValueError("has the same brightness nearly everywhere", "image")
    rows, columns = _peaks(np.nan_to_num(image, nan=background) - background, noise)
    offsets = np.arange(-_HALF, _HALF + 1)
    windows = image[rows[:, None, None] + offsets[:, None], columns[:, None, None] + offsets]
    good = np.all(np.isfinite(windows) & (windows < saturation), axis=(1, 2))
    fit, covariance, ended = _fit(windows[good].reshape(-1, (2 * _HALF + 1) ** 2), noise)
    amplitude, x, y, width, _ = fit.T
    with np.errstate(invalid="ignore"):
        star = ended & (amplitude > 0) & (np.maximum(np.abs(x), np.abs(y)) < 1.5)
        star &= (width > _WIDTHS[0]) & (width < _WIDTHS[1])
    return StarPositions(
        columns[good][star] + 1.0 + x[star],
        rows[good][star] + 1.0 + y[star],
        covariance[star],
        amplitude[star],
    )


def _background(values: FloatArray) -> tuple[float, float]:
    """Return level and standard deviation of the background: brightness clipped at 3 sigma.

    Stars lie above it; clipped at ±3, a normal distribution has 0.9866 of its deviation.
    """
    kept = values
    for _ in range(_CLIPPINGS):
        if not len(kept):
            return float("nan"), float("nan")
        level, spread = float(np.median(kept)), float(mad(kept))
        inside = np.abs(values - level) <= 3.0 * spread
        if np.count_nonzero(inside) == len(kept):
            break
        kept = values[inside]
    return level, float(np.std(kept)) / 0.9866


def _peaks(image: FloatArray, noise: float) -> tuple[AnyArray, AnyArray]:
    """Return rows and columns of maxima of the smoothed image, away from its edges."""
    smooth = gaussian_filter(image, 1.0)
    peak = (smooth == maximum_filter(smooth, 5)) & (smooth > _THRESHOLD * _SMOOTHED_NOISE * noise)
    rows, columns = np.nonzero(peak)
    inside = (np.minimum(rows, columns) >= _HALF) & (rows < image.shape[0] - _HALF)
    inside &= columns < image.shape[1] - _HALF
    return rows[inside], columns[inside]


def _fit(windows: FloatArray, noise: float) -> tuple[FloatArray, FloatArray, AnyArray]:
    """Return (flux, x, y, width, background) (N, 5), covariance (N, 2, 2) of x, y, and success.

    Levenberg and Marquardt's method on all windows (N, 49) at once.
    """
    count = len(windows)
    guess = _first_guess(windows, noise)
    damping = np.full(count, 1e-3)
    model, slopes = _gaussian(guess)
    cost = np.sum((windows - model) ** 2, axis=1)
    moved = np.full(count, np.inf)
    for _ in range(_STEPS):
        normal = np.einsum("nki,nkj->nij", slopes, slopes)
        right = np.einsum("nki,nk->ni", slopes, windows - model)
        damped = normal * (1.0 + damping[:, None, None] * np.eye(5))
        step = np.linalg.solve(damped + 1e-12 * np.eye(5), right[..., None])[..., 0]
        trial = guess + step
        trial[:, 3] = np.clip(trial[:, 3], 0.5 * guess[:, 3], 2.0 * guess[:, 3])
        trial[:, 3] = np.clip(trial[:, 3], 0.15, 10.0)
        trial[:, 1:3] = np.clip(trial[:, 1:3], -_HALF, _HALF)
        new_model, new_slopes = _gaussian(trial)
        new_cost = np.sum((windows - new_model) ** 2, axis=1)
        better = new_cost <= cost
        moved = np.where(better, np.max(np.abs(step[:, 1:3]), axis=1), moved)
        guess[better], model[better], slopes[better] = (
            trial[better],
            new_model[better],
            new_slopes[better],
        )
        cost = np.where(better, new_cost, cost)
        damping = np.where(better, 0.1 * damping, 10.0 * damping)
        if np.all(moved < _STEP_TOLERANCE):
            break
    variance = cost / (windows.shape[1] - 5)
    variance = np.where(variance > _LARGER * noise**2, variance, noise**2)
    normal = np.einsum("nki,nkj->nij", slopes, slopes)
    ended = (np.linalg.cond(normal) < 1e14) & (moved < 1e-3)
    covariance = np.full((count, 2, 2), np.nan)
    covariance[ended] = variance[ended, None, None] * np.linalg.inv(normal[ended])[:, 1:3, 1:3]
    return guess, covariance, ended


def _first_guess(windows: FloatArray, noise: float) -> FloatArray:
    """Return (flux, x, y, width, background) (N, 5) by moments of the middle 3 × 3 pixels."""
    level = np.median(windows, axis=1)
    above = windows - level[:, None]
    middle = above.reshape(-1, 2 * _HALF + 1, 2 * _HALF + 1)[:, _HALF - 1 : _HALF + 2]
    middle = np.maximum(middle[:, :, _HALF - 1 : _HALF + 2], 0.0)
    total = np.maximum(middle.sum(axis=(1, 2)), noise)
    x = (middle[:, :, 2] - middle[:, :, 0]).sum(axis=1) / total
    y = (middle[:, 2] - middle[:, 0]).sum(axis=1) / total
    flux = np.maximum(np.sum(above, axis=1), noise)
    return np.column_stack([flux, x, y, np.full(len(windows), 0.7), level])


def _gaussian(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the model (N, 49) and its partials (N, 49, 5) of (flux, x, y, width, background)."""
    flux, x, y, width, background = parameters.T[..., None]
    edges = np.arange(-_HALF, _HALF + 2) - 0.5
    (along_x, dx, wx), (along_y, dy, wy) = (_profile(edges, at, width) for at in (x, y))

    def grid(rows: FloatArray, columns: FloatArray) -> FloatArray:
        return (rows[:, :, None] * columns[:, None, :]).reshape(-1, (2 * _HALF + 1) ** 2)

    unit = grid(along_y, along_x)
    slopes = [
        unit, flux * grid(along_y, dx), flux * grid(dy, along_x),
        flux * (grid(wy, along_x) + grid(along_y, wx)), np.ones_like(unit),
    ]  # fmt: skip
    return background + flux * unit, np.stack(slopes, axis=-1)


def _profile(
    edges: FloatArray, at: FloatArray, width: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a Gaussian's integrals over pixels (N, 7) and their partials by place and width."""
    z = (edges - at) / width
    density = np.exp(-0.5 * z * z) / (np.sqrt(2 * np.pi) * width)
    integral = np.diff(0.5 * erf(z / np.sqrt(2.0)), axis=1)
    return integral, -np.diff(density, axis=1), -np.diff(density * z, axis=1)
