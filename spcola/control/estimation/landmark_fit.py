"""Landmark vectors and spacecraft states from pixel residuals (Gaskell et al., eqs. 4–14).

Each solution iterates normal equations ``M δq = w`` with a-priori terms on the diagonal and in
w; its covariance is the inverse of M. The formal uncertainty of one solution enters the weights of
the next: a landmark's observations include the uncertainty of the states, a state's that of the
landmarks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from spcola.arrays import BoolArray, FloatArray, check_finite, check_shape, frozen
from spcola.camera import SpcImage, partials_position, partials_rotation, project_image, rotate_axes
from spcola.errors import InvalidValueError, NotObservableError

S = TypeVar("S")

LANDMARK_PARAMETERS = ("V x", "V y", "V z")
STATE_PARAMETERS = ("tau 1", "tau 2", "tau 3", "V0 x", "V0 y", "V0 z")

CONDITION = 1e-12
"""Smallest eigenvalue of the normal matrix, scaled to a unit diagonal, above rounding."""


_TOLERANCE = 1e-6
"""Step, relative to its own formal sigma, at which an iteration ends."""
_MOST_STEPS = 20


class Prior(NamedTuple):
    """An a-priori value (n,) with one standard deviation each (n,); NaN sigma: not constrained."""

    value: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False)
class LandmarkSolution:
    """A landmark vector [10].

    Parameters
    ----------
    estimate : (3,) ndarray
        V, body-fixed, metres.
    covariance : (3, 3) ndarray
        Covariance of V, square metres.
    residuals : (N, 2) ndarray
        Observed less predicted pixel and line in each image.
    iterations : int
        Steps taken.
    converged : bool
        Whether the last step was below the tolerance.
    reason : str
        Why the iteration stopped.
    gain : (N, 3, 2) ndarray
        ∂V/∂(pixel, line) of each observation, metres per pixel: it propagates errors of
        observations and states into V.
    """

    estimate: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    iterations: int
    converged: bool
    reason: str
    gain: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """One standard deviation (3,), metres."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class StateSolution:
    """A spacecraft state [11, 14].

    Parameters
    ----------
    image : SpcImage
        The image with the new V0, axes and their sigmas.
    covariance : (6, 6) ndarray
        Covariance of (τ1, τ2, τ3, V0), in radians and metres.
    residuals : (N, 2) ndarray
        Observed less predicted pixel and line of each landmark.
    iterations, converged, reason
        As in :class:`LandmarkSolution`.
    """

    image: SpcImage
    covariance: FloatArray
    residuals: FloatArray
    iterations: int
    converged: bool
    reason: str


def solve_normal(
    matrix: FloatArray, right: FloatArray, parameters: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Solve ``M δq = w`` and return δq (n,) and the covariance M⁻¹ (n, n) [7].

    Raises
    ------
    NotObservableError
        If M is rank deficient; the error names the parameters that are not determined.
    """
    scale = np.sqrt(np.diag(matrix))
    empty = ~(scale > 0)
    if empty.any():
        raise _not_observable(parameters, empty)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    free = values < CONDITION
    if free.any():
        share = np.sqrt(np.sum(vectors[:, free] ** 2, axis=1))
        raise _not_observable(parameters, share > 0.1)
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return inverse @ right, inverse


def solve_landmark(
    start: ArrayLike,
    images: Sequence[SpcImage],
    observed: ArrayLike,
    sigma_px: ArrayLike,
    *,
    state_covariance: ArrayLike | None = None,
    prior: Prior | None = None,
) -> LandmarkSolution:
    """Return the landmark vector determined by its places in several images [9, 10].

    Parameters
    ----------
    start : (3,) array_like
        V to start from, body-fixed, metres.
    images : sequence of N SpcImage
        Images with the landmark. Finite sigmas of V0 and pointing add to the variance.
    observed : (N, 2) array_like
        Pixel and line in each image.
    sigma_px : (N,) array_like or float, or (N, 2, 2) array_like
        One standard deviation of each, pixels, or covariances, pixels².
    state_covariance : (N, 6, 6) array_like, optional
        Covariance of (τ1, τ2, τ3, V0) of each image, which replaces its sigmas: correlated errors
        of position and pointing hardly move the ground.
    prior : Prior, optional
        Prior of V, metres.

    Raises
    ------
    NotObservableError
        If images and prior leave a direction free (such as one image alone).
    InvalidValueError
        If observations or sigmas have another shape, are not finite, or a sigma not positive.
    """
    seen, noise = _checked(observed, sigma_px, len(images))
    states = _state_covariances(images, state_covariance)

    def linearise(point: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        residuals, partials = np.empty((len(images), 2)), np.empty((len(images), 2, 3))
        variances = np.empty((len(images), 2, 2))
        for i, image in enumerate(images):
            residuals[i] = seen[i] - np.array(project_image(image, point))
            by_state = state_partials(image, point)
            partials[i] = by_state[:, 3:]
            variances[i] = noise[i] + by_state @ states[i] @ by_state.T
        return residuals, partials, variances

    def add_prior(point: FloatArray) -> tuple[FloatArray, FloatArray]:
        none = np.zeros(3)
        return (none, none) if prior is None else _prior_terms(prior.value - point, prior.sigma)

    begin = frozen(start, (3,), "start")
    found = _iterate(begin, linearise, add_prior, np.add, LANDMARK_PARAMETERS)
    _, partials, variances = linearise(found.state)
    gain = np.einsum("ij,naj,nab->nib", found.covariance, partials, np.linalg.inv(variances))
    return LandmarkSolution(
        found.state, found.covariance, found.residuals, found.iterations, found.converged,
        found.reason, gain,
    )  # fmt: skip


def state_partials(image: SpcImage, points: ArrayLike) -> FloatArray:
    """Return ∂(pixel, line)/∂(τ1, τ2, τ3, V0) (…, 2, 6) in an `image` at `points` [8, 12]."""
    parts = [partials_rotation(image, points), partials_position(image, points)]
    return np.concatenate(parts, axis=-1)


def solve_state(
    image: SpcImage,
    landmarks: ArrayLike,
    observed: ArrayLike,
    sigma_px: ArrayLike,
    *,
    landmark_sigma: ArrayLike | None = None,
    use_prior: bool = True,
) -> StateSolution:
    """Return the spacecraft state determined by the landmarks in an image [11, 13, 14].

    Parameters
    ----------
    image : SpcImage
        With the state to start from.
    landmarks : (N, 3) array_like
        V of each, body-fixed, metres.
    observed : (N, 2) array_like
        Pixel and line of each.
    sigma_px : (N,) array_like or float, or (N, 2, 2) array_like
        One standard deviation of each, pixels, or covariances, pixels².
    landmark_sigma : (N, 3) array_like, optional
        One standard deviation of each V, metres; adds to the observation's variance.
    use_prior : bool
        Whether the state of `image` is itself an observation, with its finite sigmas.

    Raises
    ------
    NotObservableError
        If landmarks and prior leave a parameter free (such as fewer than three landmarks without
        a prior).
    InvalidValueError
        If an array has another shape, is not finite, or a sigma not positive.
    """
    points = np.asarray(landmarks, dtype=np.float64)
    check_shape(points, (None, 3), "landmarks")
    check_finite(points, "landmarks")
    seen, noise = _checked(observed, sigma_px, len(points))
    spread = np.full(points.shape, np.nan) if landmark_sigma is None else landmark_sigma
    known = np.broadcast_to(np.asarray(spread, dtype=np.float64), points.shape)

    def linearise(now: SpcImage) -> tuple[FloatArray, FloatArray, FloatArray]:
        partials = state_partials(now, points)
        variances = noise + _spread(partials[..., 3:], known)
        return seen - np.stack(project_image(now, points), axis=1), partials, variances

    def add_prior(now: SpcImage) -> tuple[FloatArray, FloatArray]:
        if not use_prior:
            return np.zeros(6), np.zeros(6)
        # [11] turns the axes by −τ in space: the total turn so far, as τ
        turned = Rotation.from_matrix(now.axes @ image.axes.T).as_rotvec()
        missing = np.concatenate([turned, image.scobj - now.scobj])
        return _prior_terms(missing, np.concatenate([image.pointing_sigma, image.scobj_sigma]))

    found = _iterate(image, linearise, add_prior, _moved, STATE_PARAMETERS)
    deviation = np.sqrt(np.diag(found.covariance))
    solved = replace(found.state, pointing_sigma=deviation[:3], scobj_sigma=deviation[3:])
    return StateSolution(
        solved, found.covariance, found.residuals, found.iterations, found.converged, found.reason
    )


@dataclass(frozen=True, eq=False)
class _Found(Generic[S]):
    """Final state of an iteration."""

    state: S
    covariance: FloatArray
    residuals: FloatArray
    iterations: int
    converged: bool
    reason: str


def _iterate(
    start: S,
    linearise: Callable[[S], tuple[FloatArray, FloatArray, FloatArray]],
    add_prior: Callable[[S], tuple[FloatArray, FloatArray]],
    apply: Callable[[S, FloatArray], S],
    parameters: Sequence[str],
) -> _Found[S]:
    """Repeat [4–7] until the step is far below its formal sigma.

    `linearise` gives residuals (N, 2), partials (N, 2, n) and variances (N, 2, 2) at a state;
    `add_prior` the terms of the prior on the diagonal of M and in w.
    """
    state = start
    residuals, partials, variances = linearise(state)
    if not (np.isfinite(residuals).all() and np.isfinite(partials).all()):
        raise InvalidValueError("a landmark lies behind a camera", "start", "give a better start")
    for iteration in range(1, _MOST_STEPS + 1):
        weights = np.linalg.inv(variances)
        diagonal, right = add_prior(state)
        matrix = np.einsum("nai,nab,nbj->ij", partials, weights, partials) + np.diag(diagonal)
        pull = np.einsum("nai,nab,nb->i", partials, weights, residuals) + right
        step, covariance = solve_normal(matrix, pull, parameters)
        tried = apply(state, step)
        ahead = linearise(tried)
        if not np.isfinite(ahead[0]).all():
            reason = f"step {iteration} put a landmark behind a camera"
            return _Found(state, covariance, residuals, iteration - 1, False, reason)
        state, (residuals, partials, variances) = tried, ahead
        size = float(np.sqrt(max(step @ matrix @ step, 0.0)))
        if size < _TOLERANCE:
            reason = f"step of {size:.1e} sigma"
            return _Found(state, covariance, residuals, iteration, True, reason)
    reason = f"still a step of {size:.1e} sigma after {_MOST_STEPS}"
    return _Found(state, covariance, residuals, _MOST_STEPS, False, reason)


def _moved(image: SpcImage, step: FloatArray) -> SpcImage:
    """Apply (τ1, τ2, τ3, δV0) to the state of an image [11, 14]."""
    return replace(image, axes=rotate_axes(image.axes, step[:3]), scobj=image.scobj + step[3:])


def _prior_terms(missing: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return 1/σ² for the diagonal and (Q − q)/σ² for w; nothing where σ is NaN."""
    known = np.isfinite(sigma)
    information = np.where(known, 1.0 / np.where(known, sigma, 1.0) ** 2, 0.0)
    return information, np.where(known, missing, 0.0) * information


def _spread(partials: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the variance (…, 2, 2) of pixel and line due to independent sigmas (…, 3).

    NaN sigmas are unknown and add nothing: the weights are then those of the pixels alone.
    """
    scaled = partials * np.nan_to_num(sigma)[..., None, :]
    return scaled @ np.swapaxes(scaled, -1, -2)


def _state_covariances(images: Sequence[SpcImage], given: ArrayLike | None) -> FloatArray:
    """Return covariances (N, 6, 6) of states: those given, else from finite sigmas."""
    if given is not None:
        covariances = np.asarray(given, dtype=np.float64)
        check_shape(covariances, (len(images), 6, 6), "state_covariance")
        check_finite(covariances, "state_covariance")
        return covariances
    sigmas = [np.concatenate([image.pointing_sigma, image.scobj_sigma]) for image in images]
    known: FloatArray = np.nan_to_num(np.array(sigmas).reshape(-1, 6))
    return known[:, :, None] ** 2 * np.eye(6)


def _checked(observed: ArrayLike, sigma_px: ArrayLike, count: int) -> tuple[FloatArray, FloatArray]:
    """Return observations (N, 2) and their covariances (N, 2, 2), refused unless sound."""
    seen = np.asarray(observed, dtype=np.float64)
    check_shape(seen, (count, 2), "observed")
    check_finite(seen, "observed")
    given = np.asarray(sigma_px, dtype=np.float64)
    if given.ndim == 3:
        check_shape(given, (count, 2, 2), "sigma_px")
        if not (np.isfinite(given).all() and (np.linalg.eigvalsh(given) > 0).all()):
            raise InvalidValueError("must be positive definite", "sigma_px")
        return seen, given
    if given.ndim:
        check_shape(given, (count,), "sigma_px")
    if not (np.isfinite(given).all() and (given > 0).all()):
        raise InvalidValueError("must be positive", "sigma_px")
    return seen, np.broadcast_to(given, (count,))[:, None, None] ** 2 * np.eye(2)


def _not_observable(parameters: Sequence[str], free: BoolArray) -> NotObservableError:
    """Return the error that names the free parameters."""
    names = tuple(name for name, loose in zip(parameters, free, strict=True) if loose)
    return NotObservableError(
        f"the observations leave {', '.join(names)} free", names, do="add images or a prior"
    )
