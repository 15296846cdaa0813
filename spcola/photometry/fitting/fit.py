"""Fit of the parameters of a photometric function to brightnesses of ground.

The model is ``I = λ_j A Φ(p)``: λ_j of each image is eliminated exactly, so that the parameters and
their covariance are those of the joint solution. Robust (Tukey's weights after Huber's),
Levenberg–Marquardt, within the parameters' bounds. A weak prior, half the bounds wide, makes
parameters that the data do not determine stay near their defaults; they are named.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import NotObservableError
from spcola.math.robust import TUKEY, biweight, huber_weight, mad
from spcola.photometry.fitting.samples import PhotometricSamples
from spcola.photometry.fitting.slope_errors import common_errors, slope_error, slope_response
from spcola.photometry.functions import PhotometricFunction

_MOST_ROUNDS = 60
# Rounds with Huber's weights: a start for Tukey's.
_HUBER_ROUNDS = 6
# A step that lowers χ² by less is the last.
_SETTLED = 1e-2
# Damping of the normal matrix's diagonal, Levenberg–Marquardt.
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-9, 1e8
# Largest share of the prior's variance that is left to a determined parameter.
_DETERMINED = 0.1
# Correlation of two parameters of which the data determine little more than a combination.
_CORRELATED = 0.98
# Fewest places for each parameter, of which the covariance is that of their scatter.
_PLACES = 4
# Fewest samples for each unknown.
_FEWEST = 5
# Prior's sigma of λ where it is common to all images, over λ: none.
_WIDE = 1e3
# Smallest spread of residuals, relative brightness: below the rounding of any image.
_LEAST_SPREAD = 1e-6


class Doubt(StrEnum):
    """Why the value of a parameter is not to be relied on."""

    UNDETERMINED = "undetermined"
    AT_BOUND = "at-bound"
    CORRELATED = "correlated"


@dataclass(frozen=True, eq=False)
class PhotometricFit:
    """A photometric function whose parameters were fitted.

    Attributes
    ----------
    function : PhotometricFunction
        With the fitted parameters.
    covariance : (P, P) ndarray
        Of the parameters; errors that are common to the samples of one place are included, and
        the share of errors by slopes that is common to all places.
    doubts : dict
        Parameters that are not to be relied on: name to code and text.
    spread : float
        Robust standard deviation of the residuals, over an image's mean brightness.
    residual : (N,) ndarray
        Observed minus fitted brightness, over the image's mean.
    design_effect : float
        Samples for an independent one.
    converged : bool
    iterations : int
    slope_sigma : float
        Error of the slopes of blocks, radians, by the scatter of the residuals.
    scale : (2,) of float, optional
        λ where it is common to all images, and its standard deviation: brightness of ground of
        relative albedo 1 at normal incidence and emission and phase 0.
    """

    function: PhotometricFunction
    covariance: FloatArray
    doubts: dict[str, tuple[Doubt, str]]
    spread: float
    residual: FloatArray
    design_effect: float
    converged: bool
    iterations: int
    slope_sigma: float
    scale: tuple[float, float] | None = None

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations (P,) of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    def chi_square(self, spread: float) -> FloatArray:
        """Return twice Tukey's loss (N,) of the residuals over a spread: χ² without outliers."""
        inside = np.minimum((self.residual / (TUKEY * spread)) ** 2, 1.0)
        loss: FloatArray = TUKEY**2 / 3.0 * (1.0 - (1.0 - inside) ** 3)
        return loss


@dataclass(frozen=True, eq=False)
class _Point:
    """The linearised problem at some parameters: residual (N,) and design (P, N) without λ.

    `model` (N,) is brightness over λ, `scale` (K,) λ of each image, and `shift` (P, K) what it
    changes by with each parameter.
    """

    values: FloatArray
    residual: FloatArray
    design: FloatArray
    model: FloatArray
    scale: FloatArray
    shift: FloatArray


def fit_function(samples: PhotometricSamples, function: PhotometricFunction) -> PhotometricFit:
    """Fit the parameters of a function, which start from its values.

    Parameters
    ----------
    samples : PhotometricSamples
    function : PhotometricFunction

    Raises
    ------
    NotObservableError
        If there are too few samples.
    """
    count = len(function.parameters)
    unknowns = count + int(samples.image.max(initial=-1)) + 1
    if len(samples) < max(_FEWEST * unknowns, 1):
        raise NotObservableError(
            f"only {len(samples)} places are well seen and well lit, for {unknowns} unknowns",
            where=function.name,
            do="more images or maplets are needed",
        )
    lower = np.array([one.lower for one in function.parameters])
    upper = np.array([one.upper for one in function.parameters])
    prior = 0.5 * (upper - lower)
    start = np.array(function.values)
    weight: FloatArray = np.ones(len(samples))
    values, damping, converged, rounds = start.copy(), _FIRST_DAMPING, count == 0, 0
    point = _linearised(samples, function, values, weight)
    for rounds in range(1, _MOST_ROUNDS + 1):
        spread = max(float(mad(point.residual)), _LEAST_SPREAD)
        kind = huber_weight if rounds <= _HUBER_ROUNDS else biweight
        weight = kind(point.residual / spread)
        point = _linearised(samples, function, values, weight)
        if not count:
            if rounds > _HUBER_ROUNDS + 2:
                break
            continue
        point, gain, damping = _improved(samples, function, point, (start, prior, weight, damping))
        values = point.values
        converged = rounds > _HUBER_ROUNDS and gain < _SETTLED
        if converged:
            break
    fitted = _with(function, values)
    return _judged(samples, fitted, point, (weight, prior, converged, rounds))


def _with(function: PhotometricFunction, values: FloatArray) -> PhotometricFunction:
    """Return the function with these values, within its bounds."""
    return function.having(
        {
            one.name: float(np.clip(value, one.lower, one.upper))
            for one, value in zip(function.parameters, values, strict=True)
        }
    )


def _linearised(
    samples: PhotometricSamples,
    function: PhotometricFunction,
    values: FloatArray,
    weight: FloatArray,
) -> _Point:
    """Return residuals and their derivatives, λ of each image eliminated with these weights."""
    at = _with(function, values)
    place = samples.cosines[0], samples.cosines[1], samples.phase
    model, partials = samples.means(at(*place)), samples.means(at.by_parameters(*place))
    square = _sums(samples, weight * model**2)
    scale = _sums(samples, weight * samples.brightness * model) / square
    each = scale[samples.image]
    design = np.empty_like(partials)
    shift = np.empty((len(partials), len(scale)))
    for k, row in enumerate(each * partials):
        shift[k] = -_sums(samples, weight * model * row) / square
        design[k] = row + model * shift[k][samples.image]
    return _Point(values, samples.brightness - each * model, design, model, scale, shift)


def _sums(samples: PhotometricSamples, layer: FloatArray) -> FloatArray:
    """Return the sums over each image."""
    sums = np.bincount(samples.image, layer)
    return np.where(sums != 0.0, sums, 1.0)


def _improved(
    samples: PhotometricSamples,
    function: PhotometricFunction,
    point: _Point,
    state: tuple[FloatArray, FloatArray, FloatArray, float],
) -> tuple[_Point, float, float]:
    """Take a damped step that lowers the cost, by how much; the same point where none does."""
    start, prior, weight, damping = state
    spread = max(float(mad(point.residual)), _LEAST_SPREAD)

    def cost(at: _Point) -> float:
        away = (at.values - start) / prior
        return float(np.sum(weight * at.residual**2)) / spread**2 + float(away @ away)

    lower = np.array([one.lower for one in function.parameters])
    upper = np.array([one.upper for one in function.parameters])
    design = point.design * prior[:, None] / spread
    normal = (design * weight) @ design.T + np.eye(len(prior))
    right = (design * weight) @ (point.residual / spread) - (point.values - start) / prior
    # A parameter at its bound that would go beyond stays there.
    free = ~((point.values <= lower) & (right < 0) | (point.values >= upper) & (right > 0))
    before = cost(point)
    while damping < _MOST_DAMPING and free.any():
        some = normal[np.ix_(free, free)]
        step = np.zeros(len(prior))
        step[free] = np.linalg.solve(some + damping * np.diag(np.diag(some)), right[free])
        values = np.clip(point.values + prior * step, lower, upper)
        tried = _linearised(samples, function, values, weight)
        gain = before - cost(tried)
        if gain >= 0.0:
            return tried, gain, max(damping / 10.0, _LEAST_DAMPING)
        damping *= 10.0
    return point, 0.0, _FIRST_DAMPING


def _judged(
    samples: PhotometricSamples,
    function: PhotometricFunction,
    point: _Point,
    state: tuple[FloatArray, FloatArray, bool, int],
) -> PhotometricFit:
    """Return the fit with its covariance, and what it does not determine."""
    weight, prior, converged, rounds = state
    spread = max(float(mad(point.residual)), _LEAST_SPREAD)
    pull = weight * point.residual / spread
    design = point.design * prior[:, None] / spread
    count, level = len(design), samples.level
    if level is not None:
        # λ, in units so wide that its prior has no weight.
        wide = _WIDE * float(point.scale[0])
        design = np.vstack([design, wide * point.model / spread])
        prior = np.append(prior, wide)
    # Tukey's weights lower the information by the mean derivative of the scores.
    inside = np.minimum((point.residual / (TUKEY * spread)) ** 2, 1.0)
    slope = max(float(np.mean((1.0 - inside) * (1.0 - 5.0 * inside))), 0.1)
    information = slope * design @ design.T
    meat = _clustered(samples, design, pull)
    effect = _design_effect(samples, design[:count], pull)
    if not converged or int(samples.place.max()) + 1 < _PLACES * len(design):
        # Too few places for a matrix of their own.
        meat = effect * information
    slope_sigma, common = _slope_errors(samples, function, point)
    shift = design @ (weight * common / spread).T
    meat = meat + shift @ shift.T
    covariance = _posterior(information, meat)
    doubts = _doubts(function, covariance[:count, :count])
    scaled = prior[:, None] * covariance * prior
    scale = None
    if level is not None:
        change = np.append(point.shift[:, 0], 1.0)
        sigma = float(np.sqrt(change @ scaled @ change))
        scale = level * float(point.scale[0]), level * sigma
    return PhotometricFit(
        function, scaled[:count, :count], doubts, spread, point.residual, effect, converged,
        rounds, slope_sigma, scale,
    )  # fmt: skip


def _slope_errors(
    samples: PhotometricSamples, function: PhotometricFunction, point: _Point
) -> tuple[float, FloatArray]:
    """Return the error of slopes, radians, and errors (4, N) that are common to all places."""
    each = point.scale[samples.image]
    fitted, response = each * point.model, each * slope_response(samples, function)
    # The error of albedo that a place has in all images would hide that of slopes.
    square = np.bincount(samples.place, fitted**2)
    places = np.bincount(samples.place, fitted * point.residual) / square
    within = point.residual - places[samples.place] * fitted
    sigma = slope_error(within, fitted, response)
    return sigma, common_errors(samples, response, sigma)


def _clustered(samples: PhotometricSamples, rows: FloatArray, pull: FloatArray) -> FloatArray:
    """Return the covariance (P, P) of the scores of rows (P, N), samples of a place together."""
    places = int(samples.place.max()) + 1
    if not len(rows):
        return np.zeros((0, 0))
    scores = np.stack([np.bincount(samples.place, row * pull, places) for row in rows])
    meat: FloatArray = places / max(places - 1, 1) * scores @ scores.T
    return meat


def _design_effect(samples: PhotometricSamples, design: FloatArray, pull: FloatArray) -> float:
    """Return the samples for an independent one.

    Without parameters it is that on a quantity that all samples of a place have in common.
    """
    rows = design if len(design) else np.ones((1, len(samples)))
    together = np.diag(_clustered(samples, rows, pull))
    alone = np.sum((rows * pull) ** 2, axis=1)
    used = alone > 0.0
    effect = float(np.mean(together[used] / alone[used])) if used.any() else 1.0
    return max(effect, 1.0)


def _posterior(information: FloatArray, meat: FloatArray) -> FloatArray:
    """Return the covariance (P, P) in units of the prior: H B⁻¹ H is the data's information."""
    size = len(information)
    if not size:
        return np.zeros((0, 0))
    scale = np.sqrt(np.maximum(np.diag(meat), 1e-30))
    unit = meat / np.outer(scale, scale) + 1e-9 * np.eye(size)
    known = information / scale[:, None]
    data = known.T @ np.linalg.solve(unit, known)
    posterior: FloatArray = np.linalg.inv(0.5 * (data + data.T) + np.eye(size))
    return posterior


def _doubts(function: PhotometricFunction, covariance: FloatArray) -> dict[str, tuple[Doubt, str]]:
    """Name the parameters that are not determined; `covariance` is in units of the prior."""
    doubts: dict[str, tuple[Doubt, str]] = {}
    sigma = np.sqrt(np.diag(covariance))
    related = covariance / np.outer(sigma, sigma)
    weak: BoolArray = sigma**2 > _DETERMINED
    for k, (one, value) in enumerate(zip(function.parameters, function.values, strict=True)):
        others = np.abs(related[k]) * (np.arange(len(sigma)) != k)
        strongest = int(np.argmax(others))
        if weak[k]:
            text = f"the data do not determine {one.name}"
            doubts[one.name] = Doubt.UNDETERMINED, text
        elif value <= one.lower or value >= one.upper:
            text = f"{one.name} is at the bound of what is allowed, {value:g}"
            doubts[one.name] = Doubt.AT_BOUND, text
        elif others[strongest] > _CORRELATED:
            text = (
                f"{one.name} and {function.parameters[strongest].name} are correlated by "
                f"{related[k, strongest]:.3f}: little more than a combination is determined"
            )
            doubts[one.name] = Doubt.CORRELATED, text
    return doubts
