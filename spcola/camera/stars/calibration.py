"""Calibration of a camera from stars: interior orientation and attitudes, with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.camera.camera import Camera
from spcola.camera.projection import project_vectors, rotate_axes, turn_partials
from spcola.camera.stars.centroids import StarPositions
from spcola.camera.stars.parameters import SolvedParameters
from spcola.errors import NotObservableError

_MAX_STEPS = 40
# A step below this share of its sigma ends the iteration.
_SMALL_STEP = 1e-4
# Reduced squared misses are those of two numbers: 99.99 % are below 18.4.
_FARTHEST = 18.4
_MEDIAN_OF_TWO = 1.386
# Smallest eigenvalue of the scaled normal matrix: below, the data do not separate the parameters.
_SMALLEST_SHARE = 1e-10


@dataclass(frozen=True, eq=False)
class StarFrame:
    """The identified stars of one image.

    Parameters
    ----------
    name : str
    stars : StarPositions
        Measured (N).
    directions : (N, 3) ndarray
        Their apparent directions, unit vectors, inertial.
    axes : (3, 3) ndarray
        Approximate attitude, rows inertial.
    attitude_sigma : float
        One standard deviation of each rotation of `axes`, radians; infinite if it is unknown.
    """

    name: str
    stars: StarPositions
    directions: FloatArray
    axes: FloatArray
    attitude_sigma: float = np.inf


@dataclass(frozen=True, eq=False)
class SolvedFrame:
    """Attitude of one image, and what is left of its stars.

    Parameters
    ----------
    name : str
    axes : (3, 3) ndarray
        Rows Cx, Cy, Cz, inertial.
    covariance : (3, 3) ndarray
        Of the rotations about Cx, Cy, Cz, radians², with the camera's uncertainty.
    residual : (N, 2) ndarray
        Measured less predicted pixel and line.
    used : (N,) ndarray of bool
        False for stars that were rejected.
    """

    name: str
    axes: FloatArray
    covariance: FloatArray
    residual: FloatArray
    used: BoolArray


@dataclass(frozen=True, eq=False)
class StarCalibration:
    """A calibrated camera.

    Parameters
    ----------
    camera : Camera
    names : tuple of str
        The solved parameters.
    estimate : (P,) ndarray
        Their values.
    covariance : (P, P) ndarray
        By the measurements' covariances; multiplied by `unit_variance` where that is above 1.
    frames : tuple of SolvedFrame
    unit_variance : float
        Sum of squared reduced residuals over degrees of freedom; 1 where the measurements'
        covariances are right and the model fits.
    iterations : int
    converged : bool
        False if the steps did not become small.
    """

    camera: Camera
    names: tuple[str, ...]
    estimate: FloatArray
    covariance: FloatArray
    frames: tuple[SolvedFrame, ...]
    unit_variance: float
    iterations: int
    converged: bool

    @property
    def sigma(self) -> FloatArray:
        """One standard deviation of each parameter (P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def residual_rms(self) -> float:
        """Root mean square of the used stars' residuals in one coordinate, pixels."""
        left = np.concatenate([frame.residual[frame.used] for frame in self.frames])
        return float(np.sqrt(np.mean(left**2)))


def calibrate(
    frames: Sequence[StarFrame], camera: Camera, parameters: SolvedParameters
) -> StarCalibration:
    """Solve a camera's interior orientation and the attitude of each image from stars.

    Least squares over all images, as Gaskell et al. (§2.2) describe it: residuals of star positions
    weighted by their covariances. Gauss and Newton's method; Cauchy weights first, so that false
    stars do not steer it, then all stars within 99.99 % of their covariance with full weight, the
    choice of which is repeated until it is the same.

    Parameters
    ----------
    frames : sequence of StarFrame
        Identified stars of each image.
    camera : Camera
        Nominal.
    parameters : SolvedParameters
        What is solved; see :func:`solved_parameters`.

    Raises
    ------
    NotObservableError
        If the stars do not determine the parameters.
    """
    axes = [frame.axes for frame in frames]
    weights = _robust_weights(frames, camera, axes)
    hard, converged, iteration = False, False, 0
    for iteration in range(1, _MAX_STEPS + 1):
        system = _system(frames, camera, axes, weights, parameters)
        step, turns, sigma = system.solve()
        camera = parameters.applied(camera, parameters.value(camera) + step)
        axes = [rotate_axes(one, turn) for one, turn in zip(axes, turns, strict=True)]
        small = bool(np.max(np.abs(step) / sigma) < _SMALL_STEP) if len(step) else True
        old = weights
        weights = (_kept if hard else _robust_weights)(frames, camera, axes)
        same = all(np.array_equal(a, b) for a, b in zip(old, weights, strict=True))
        if hard and small and same:
            converged = True
            break
        hard = hard or bool(np.max(np.abs(step) / sigma, initial=0.0) < 0.1) or iteration > 12
    return _result(frames, camera, axes, weights, (parameters, iteration, converged))


class _System:
    """Normal equations of camera and attitudes, the attitudes eliminated image by image."""

    def __init__(self, parameters: SolvedParameters, count: int) -> None:
        size = len(parameters.names)
        self.parameters = parameters
        self.camera = np.zeros((size, size))
        self.right = np.zeros(size)
        self.mixed = np.zeros((count, size, 3))
        self.attitude = np.zeros((count, 3, 3))
        self.turn = np.zeros((count, 3))

    def add(
        self,
        index: int,
        frame: StarFrame,
        partials: tuple[FloatArray, FloatArray],
        miss: FloatArray,
        weight: FloatArray,
    ) -> None:
        """Add the stars of one image: partials by camera (N, 2, P) and turns, misses, weights."""
        seen = np.isfinite(miss).all(axis=1) & (weight > 0)
        by_camera, by_turn, miss = partials[0][seen], partials[1][seen], miss[seen]
        inverse = weight[seen, None, None] * np.linalg.inv(frame.stars.covariance[seen])
        self.camera += np.einsum("nki,nkl,nlj->ij", by_camera, inverse, by_camera)
        self.right += np.einsum("nki,nkl,nl->i", by_camera, inverse, miss)
        self.mixed[index] = np.einsum("nki,nkl,nlj->ij", by_camera, inverse, by_turn)
        self.attitude[index] = np.einsum("nki,nkl,nlj->ij", by_turn, inverse, by_turn)
        self.turn[index] = np.einsum("nki,nkl,nl->i", by_turn, inverse, miss)

    def add_prior(self, index: int, frame: StarFrame, axes: FloatArray) -> None:
        """Add what is known of an image's attitude."""
        # the turns [11] from this attitude to the prior one
        to_prior = frame.axes @ axes.T
        skew = 0.5 * (to_prior - to_prior.T)
        away = np.array([skew[1, 2], skew[2, 0], skew[0, 1]])
        self.attitude[index] += np.eye(3) / frame.attitude_sigma**2
        self.turn[index] += away / frame.attitude_sigma**2

    def solve(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return steps of the camera (P,) and turns (F, 3), and the parameters' sigmas (P,).

        Raises
        ------
        NotObservableError
            If they are not determined.
        """
        covariance = self.covariance()
        held = np.linalg.solve(self.attitude, self.turn[..., None])[..., 0]
        step = covariance @ (self.right - np.einsum("fpi,fi->p", self.mixed, held))
        moved = np.einsum("fpi,p->fi", self.mixed, step)
        turns = held - np.linalg.solve(self.attitude, moved[..., None])[..., 0]
        return step, turns, np.sqrt(np.diag(covariance))

    def covariance(self) -> FloatArray:
        """Return the covariance (P, P) of the camera's parameters.

        Raises
        ------
        NotObservableError
            If an image's attitude or the parameters are not determined.
        """
        if np.any(np.linalg.cond(self.attitude) > 1e14):
            index = int(np.argmax(np.linalg.cond(self.attitude)))
            raise NotObservableError(
                f"image {index + 1} has too few stars for its attitude", where="star calibration"
            )
        eliminated = np.linalg.solve(self.attitude, np.swapaxes(self.mixed, 1, 2))
        normal = self.camera - np.einsum("fpi,fiq->pq", self.mixed, eliminated)
        # by what the parameters would weigh alone: a share near 0 is another's or an attitude's
        scale = 1.0 / np.sqrt(np.maximum(np.diag(self.camera), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(scale[:, None] * normal * scale)
        if len(values) and values[0] < _SMALLEST_SHARE:
            part = np.abs(vectors[:, 0])
            names = [n for n, p in zip(self.parameters.names, part, strict=True) if p > 0.3]
            raise NotObservableError(
                f"the stars do not determine {', '.join(names)}",
                tuple(names),
                "star calibration",
                "solve fewer parameters, or add images in which stars cover the field",
            )
        inverse = (vectors / values) @ vectors.T
        found: FloatArray = scale[:, None] * inverse * scale
        return found


def _system(
    frames: Sequence[StarFrame],
    camera: Camera,
    axes: Sequence[FloatArray],
    weights: Sequence[FloatArray],
    parameters: SolvedParameters,
) -> _System:
    """Return the normal equations of all images."""
    system = _System(parameters, len(frames))
    seen = [frame.directions @ one.T for frame, one in zip(frames, axes, strict=True)]
    by_camera = _camera_partials(camera, parameters, np.concatenate(seen))
    parts = np.split(by_camera, np.cumsum([len(one) for one in seen])[:-1])
    for index, frame in enumerate(frames):
        by_turn = turn_partials(camera, seen[index])
        miss = _miss(frame, camera, axes[index])
        system.add(index, frame, (parts[index], by_turn), miss, weights[index])
        if np.isfinite(frame.attitude_sigma):
            system.add_prior(index, frame, axes[index])
    return system


def _camera_partials(
    camera: Camera, parameters: SolvedParameters, vectors: FloatArray
) -> FloatArray:
    """Return ∂(pixel, line)/∂parameters (N, 2, P) by central differences."""
    values, steps = parameters.value(camera), parameters.steps(camera)
    columns = []
    for index, step in enumerate(steps):
        moved = np.zeros(len(steps))
        moved[index] = step
        above = project_vectors(parameters.applied(camera, values + moved), vectors)
        below = project_vectors(parameters.applied(camera, values - moved), vectors)
        columns.append((np.stack(above, axis=-1) - np.stack(below, axis=-1)) / (2 * step))
    found: FloatArray = np.stack(columns, axis=-1) if columns else np.zeros((len(vectors), 2, 0))
    return found


def _miss(frame: StarFrame, camera: Camera, axes: FloatArray) -> FloatArray:
    """Return measured less predicted pixel and line (N, 2)."""
    predicted = np.column_stack(project_vectors(camera, frame.directions @ axes.T))
    found: FloatArray = np.column_stack([frame.stars.pixel, frame.stars.line]) - predicted
    return found


def _reduced(
    frames: Sequence[StarFrame], camera: Camera, axes: Sequence[FloatArray]
) -> list[FloatArray]:
    """Return the squared misses by their covariances (N,) of each image; infinite if not seen."""
    found = []
    for frame, one in zip(frames, axes, strict=True):
        miss = _miss(frame, camera, one)
        square = np.einsum("nk,nkl,nl->n", miss, np.linalg.inv(frame.stars.covariance), miss)
        found.append(np.nan_to_num(square, nan=np.inf))
    return found


def _robust_weights(
    frames: Sequence[StarFrame], camera: Camera, axes: Sequence[FloatArray]
) -> list[FloatArray]:
    """Return Cauchy's weights, by the median of all reduced misses."""
    squares = _reduced(frames, camera, axes)
    spread = max(float(np.median(np.concatenate(squares))) / _MEDIAN_OF_TWO, 1.0)
    return [1.0 / (1.0 + square / (2.0 * spread)) for square in squares]


def _kept(
    frames: Sequence[StarFrame], camera: Camera, axes: Sequence[FloatArray]
) -> list[FloatArray]:
    """Return 1 for the stars that are no outliers, and 0."""
    squares = _reduced(frames, camera, axes)
    spread = max(float(np.median(np.concatenate(squares))) / _MEDIAN_OF_TWO, 1.0)
    return [(square < _FARTHEST * spread).astype(np.float64) for square in squares]


def _result(
    frames: Sequence[StarFrame],
    camera: Camera,
    axes: Sequence[FloatArray],
    weights: Sequence[FloatArray],
    state: tuple[SolvedParameters, int, bool],
) -> StarCalibration:
    """Return the calibration at the solution."""
    parameters, iterations, converged = state
    system = _system(frames, camera, axes, weights, parameters)
    covariance = system.covariance()
    squares = _reduced(frames, camera, axes)
    chi2 = float(sum(np.sum(s[w > 0]) for s, w in zip(squares, weights, strict=True)))
    count = 2 * sum(int(np.count_nonzero(w)) for w in weights)
    freedom = count - len(parameters.names) - 3 * len(frames)
    if freedom <= 0:
        raise NotObservableError(
            f"{count} measured coordinates for {count - freedom} unknowns",
            parameters.names, "star calibration", "add images or stars",
        )  # fmt: skip
    unit = chi2 / freedom
    factor = max(unit, 1.0)
    solved = []
    for index, frame in enumerate(frames):
        alone = np.linalg.inv(system.attitude[index])
        through = alone @ system.mixed[index].T
        turn = alone + through @ covariance @ through.T
        solved.append(
            SolvedFrame(
                frame.name, axes[index], factor * turn, _miss(frame, camera, axes[index]),
                weights[index] > 0,
            )
        )  # fmt: skip
    return StarCalibration(
        camera, parameters.names, parameters.value(camera), factor * covariance, tuple(solved),
        unit, iterations, converged,
    )  # fmt: skip
