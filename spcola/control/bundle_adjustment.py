"""The control network of a solution: correlated errors of its landmarks and states.

The measured places of landmarks in images constrain landmarks and states relative to one another
better than either is known alone. The remaining error is mostly common to the whole network: its
position, orientation and scale. A fit that takes the landmarks' sigmas for independent errors
misjudges both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import linalg

from spcola.arrays import FloatArray, IntArray, check_shape
from spcola.camera import SpcImage, project_image
from spcola.control.estimation import state_partials
from spcola.errors import InvalidValueError
from spcola.math.robust import huber_weight, mad

__all__ = ["Network", "NetworkOptions", "solve_network"]

# Prior of camera pointing, radians: practically free. A solution turns its cameras until the
# landmarks fit, so the stated sigma of pointing is not independent of that of position.
_FREE_TURN = 0.1
# Rounds of robust weighting: weights from residuals, sigma from weighted residuals.
_ROUNDS = 3
# Places in images are rounded to so many pixels: a smaller sigma cannot be inferred.
_ROUNDED = 0.005
# Below this share of redundant residuals the sigma of a place is not estimated.
_LEAST_FREE = 0.1
# Fewer landmarks than these do not determine the orientation of a camera.
_LEAST_SEEN = 3


@dataclass(frozen=True)
class NetworkOptions:
    """Prior sigmas and limits.

    Parameters
    ----------
    pixel_sigma : float
        Prior sigma of a landmark's place in an image, pixels.
    center_sigma : float
        Sigma of a landmark whose file states none, metres, each axis.
    position_sigma : float
        Sigma of a spacecraft position whose file states none, metres, each axis.
    most_images : int
        More are thinned evenly: memory and time grow with their square and cube.
    """

    pixel_sigma: float = 0.3
    center_sigma: float = 0.05
    position_sigma: float = 1.0
    most_images: int = 1000


@dataclass(frozen=True, eq=False)
class Network:
    """Errors of N landmarks and their correlations, from their places in images.

    Attributes
    ----------
    names : tuple of str
        Names of the landmarks.
    offset : (N, 3) ndarray
        Estimated error of each V, body-fixed, metres: to be subtracted from V.
    own : (N, 3, 3) ndarray
        Covariance of the independent part of the remaining errors, square metres.
    shared : (N, 3, M) ndarray
        Patterns of shared errors, of standard deviation 1 each, metres: the covariance of landmarks
        i and j is ``shared_i shared_jᵀ``, plus `own` where i = j.
    pixel_sigma : float
        Robust standard deviation of the residuals, pixels; NaN if there are none.
    images, seen : int
        Number of images used, and of places of landmarks in them.
    """

    names: tuple[str, ...]
    offset: FloatArray
    own: FloatArray
    shared: FloatArray
    pixel_sigma: float
    images: int
    seen: int


def solve_network(
    names: Sequence[str],
    centers: FloatArray,
    sigma: FloatArray,
    images: Sequence[SpcImage],
    *,
    options: NetworkOptions | None = None,
) -> Network:
    """Adjust landmarks and states to the landmarks' places in the images (eqs. 4–14, all at once).

    Normal equations of all landmark vectors and states with their priors; the landmarks, of three
    components each, are eliminated. States have the prior of their position; their pointing is
    free, since position and pointing of a solution have correlated errors.

    Parameters
    ----------
    names : sequence of N str
    centers : (N, 3) ndarray
        V of the solution, body-fixed, metres.
    sigma : (N, 3) ndarray
        One standard deviation of each; NaN or 0 where none is stated.
    images : sequence of SpcImage
        States of the solution with the landmarks seen. Places that are marked as deweighted or
        belong to other landmarks are not used, nor are images with fewer than three.
    options : NetworkOptions, optional

    Returns
    -------
    Network
        Without images, `own` contains the landmarks' stated sigmas.

    Raises
    ------
    InvalidValueError
        If shapes disagree, a centre is not finite, or a landmark lies behind its camera.
    """
    options = options or NetworkOptions()
    check_shape(centers, (len(names), 3), "centers")
    check_shape(sigma, centers.shape, "sigma")
    stated = np.where(sigma > 0, sigma, options.center_sigma)
    sightings = _sightings(names, centers, images, options)
    if not sightings:
        own = np.einsum("ni,ij->nij", stated**2, np.eye(3))
        none = np.zeros((len(names), 3, 0))
        return Network(tuple(names), np.zeros(centers.shape), own, none, float("nan"), 0, 0)
    normal, spread = _adjusted(sightings, stated, options.pixel_sigma)
    return Network(
        names=tuple(names),
        offset=-normal.landmarks,
        own=normal.own,
        shared=normal.patterns(),
        pixel_sigma=spread,
        images=len(sightings),
        seen=sum(len(one.residual) for one in sightings),
    )


@dataclass(frozen=True, eq=False)
class _Sighting:
    """Linearised observations of K landmarks in one image."""

    landmark: IntArray  # (K,)
    residual: FloatArray  # (K, 2) observed less predicted, pixels
    by_landmark: FloatArray  # (K, 2, 3) per metre
    by_state: FloatArray  # (K, 2, 6) per radian, metre
    state_sigma: FloatArray  # (6,)


def _sightings(
    names: Sequence[str],
    centers: FloatArray,
    images: Sequence[SpcImage],
    options: NetworkOptions,
) -> list[_Sighting]:
    """Linearise each image about the solution."""
    number = {name: index for index, name in enumerate(names)}
    step = max(1, -(-len(images) // options.most_images))
    found = []
    for image in images[::step]:
        points = [p for p in image.landmarks if p.name in number and not p.deweighted]
        if len(points) < _LEAST_SEEN:
            continue
        landmark = np.array([number[point.name] for point in points])
        place = centers[landmark]
        observed = np.array([[point.pixel, point.line] for point in points])
        residual = observed - np.stack(project_image(image, place), axis=1)
        if not np.isfinite(residual).all():
            raise InvalidValueError("a landmark lies behind the camera that sees it", image.name)
        by_state = state_partials(image, place)
        known = image.scobj_sigma > 0
        position = np.where(known, image.scobj_sigma, options.position_sigma)
        sigma = np.concatenate([np.full(3, _FREE_TURN), position])
        found.append(_Sighting(landmark, residual, by_state[..., 3:], by_state, sigma))
    return found


def _adjusted(
    sightings: list[_Sighting], sigma: FloatArray, pixel_sigma: float
) -> tuple[_Normal, float]:
    """Return the robust solution, and the standard deviation of the residuals, pixels.

    `sigma` (N, 3), metres, and `pixel_sigma` are the priors of landmarks and of their places.
    """
    residual = np.concatenate([one.residual for one in sightings])
    spread, weight = pixel_sigma, huber_weight(np.zeros(len(residual)))
    for _ in range(_ROUNDS):
        normal = _Normal.of(sightings, weight / spread**2, sigma)
        left = residual - normal.predicted(sightings)
        # Each camera absorbs at least three of its residuals, each landmark some.
        free, least = normal.freedom(residual.size), _LEAST_FREE * residual.size
        spread = float(mad(left)) * float(np.sqrt(residual.size / max(free, least)))
        # Residuals without redundancy are 0 whatever the errors of the places.
        spread = max(spread, pixel_sigma if free < least else _ROUNDED)
        weight = huber_weight(np.linalg.norm(left, axis=1) / spread, k=2.5)
    return normal, spread


class _Tie(NamedTuple):
    """The images (K,) that see a landmark, and the normal matrix (K, 3, 6) between it and them."""

    images: IntArray
    blocks: FloatArray


@dataclass(frozen=True, eq=False)
class _Normal:
    """The normal equations with the landmarks eliminated, and their solution."""

    landmarks: FloatArray  # (N, 3) corrections
    states: FloatArray  # (S, 6)
    own: FloatArray  # (N, 3, 3) covariance at known states
    ties: list[_Tie]
    root: FloatArray  # (6S, 6S) lower triangular, its product with its transpose the inverse

    @classmethod
    def of(cls, sightings: list[_Sighting], weight: FloatArray, sigma: FloatArray) -> _Normal:
        """Build and solve with weights (R,), 1/pixels², of the sightings' residuals in turn."""
        count, states = len(sigma), len(sightings)
        block = np.einsum("ni,ij->nij", sigma**-2, np.eye(3))
        right = np.zeros((count, 3))
        matrix, pull = np.zeros((states, 6, states, 6)), np.zeros((states, 6))
        seen_by: list[list[int]] = [[] for _ in range(count)]
        blocks: list[list[FloatArray]] = [[] for _ in range(count)]
        start = 0
        for number, one in enumerate(sightings):
            share = weight[start : start + len(one.landmark), None, None]
            start += len(one.landmark)
            scaled = share * one.by_landmark
            block[one.landmark] += np.einsum("kai,kaj->kij", scaled, one.by_landmark)
            right[one.landmark] += np.einsum("kai,ka->ki", scaled, one.residual)
            matrix[number, :, number] += np.diag(one.state_sigma**-2)
            matrix[number, :, number] += np.einsum(
                "kai,kaj->ij", share * one.by_state, one.by_state
            )
            pull[number] += np.einsum("kai,ka->i", share * one.by_state, one.residual)
            tie = np.einsum("kai,kaj->kij", scaled, one.by_state)
            for place, other in zip(one.landmark.tolist(), tie, strict=True):
                seen_by[place].append(number)
                blocks[place].append(other)
        own = np.linalg.inv(block)
        ties = [
            _Tie(np.array(seen, dtype=np.int64), np.array(parts).reshape(-1, 3, 6))
            for seen, parts in zip(seen_by, blocks, strict=True)
        ]
        for place, (seen, parts) in enumerate(ties):
            coupling = np.einsum("kia,ij,ljb->kalb", parts, own[place], parts)
            matrix[seen[:, None], :, seen[None, :], :] -= coupling.transpose(0, 2, 1, 3)
            pull[seen] -= np.einsum("kia,ij,j->ka", parts, own[place], right[place])
        root = _inverse_root(matrix.reshape(6 * states, 6 * states))
        moved = (root @ (root.T @ pull.ravel())).reshape(states, 6)
        landmarks = np.array(
            [
                own[place] @ (right[place] - np.einsum("kia,ka->i", parts, moved[seen]))
                for place, (seen, parts) in enumerate(ties)
            ]
        )
        return cls(landmarks, moved, own, ties, root)

    def predicted(self, sightings: list[_Sighting]) -> FloatArray:
        """Residuals (R, 2) due to the corrections."""
        return np.concatenate(
            [
                np.einsum("kai,ki->ka", one.by_landmark, self.landmarks[one.landmark])
                + one.by_state @ self.states[number]
                for number, one in enumerate(sightings)
            ]
        )

    def freedom(self, size: int) -> float:
        """Redundancy of `size` residuals; below 0 if there are too few."""
        seen = np.array([len(images) for images, _ in self.ties])
        # A landmark or state absorbs no more residuals than it has.
        taken = float(np.sum(np.minimum(3, 2 * seen))) + 3.0 * len(self.states)
        return size - taken

    def patterns(self) -> FloatArray:
        """Errors of the landmarks (N, 3, M) due to those of the states."""
        count = self.root.shape[0]
        blocks = self.root.reshape(-1, 6, count)
        patterns = np.zeros((len(self.own), 3, count))
        for place, (seen, parts) in enumerate(self.ties):
            patterns[place] = -self.own[place] @ np.einsum("kia,kam->im", parts, blocks[seen])
        return patterns


def _inverse_root(matrix: FloatArray) -> FloatArray:
    """Return R with R Rᵀ the inverse of a positive definite `matrix` of metres and radians."""
    unit = 1.0 / np.sqrt(np.diag(matrix))
    lower = linalg.cholesky(matrix * np.outer(unit, unit), lower=True)
    inverse = linalg.solve_triangular(lower, np.eye(len(lower)), lower=True)
    return unit[:, None] * inverse.T
