"""How large errors of matches and of states are, by how images contradict one another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from spcola.arrays import FloatArray
from spcola.projection import partials_position
from spcola.sighting import Sighting

# Factors are known beforehand to e², standard deviation of their logarithms.
_WIDTH = 2.0
# Logarithm of a factor that is as good as none.
_SMALLEST = -6.0


class SizeFactors(NamedTuple):
    """Factors on the sigmas of matches and of states."""

    match: float
    state: float


def estimate_factors(sightings: Sequence[Sighting]) -> SizeFactors:
    """Return by what the stated errors of matches and states are to be multiplied.

    N images give 2N numbers for the three of a place. What is left, over all sightings, tells how
    large errors are: the restricted likelihood of Patterson & Thompson (1971), with a log-normal
    prior about 1. Sightings are taken as independent, as the errors of one image at two of them are
    not: the factors are estimates all the same, only less sharp than they look.

    Parameters
    ----------
    sightings : sequence of Sighting
        Those in fewer than two images tell nothing.

    Returns
    -------
    SizeFactors
        1 and 1 where nothing tells.
    """
    cases = [_case(sighting) for sighting in sightings if len(sighting) > 1]
    if not cases:
        return SizeFactors(1.0, 1.0)

    def cost(logs: FloatArray) -> float:
        match, state = np.exp(2.0 * np.clip(logs, _SMALLEST, -_SMALLEST))
        total = float(np.sum((logs / _WIDTH) ** 2))
        for left, by_match, by_state in cases:
            root = np.linalg.cholesky(match * by_match + state * by_state)
            white = np.linalg.solve(root, left)
            total += float(white @ white) + 2.0 * float(np.sum(np.log(np.diag(root))))
        return total

    simplex = np.array([[0.0, 0.0], [0.7, 0.0], [0.0, -0.7]])
    found = minimize(
        cost,
        simplex[0],
        method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 0.02, "maxiter": 120, "initial_simplex": simplex},
    )
    match, state = np.exp(np.clip(found.x, _SMALLEST, -_SMALLEST))
    return SizeFactors(float(match), float(state))


def _case(sighting: Sighting) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (K,) that no place explains, and their covariances by matches and by states."""
    solution = sighting.solve()
    place, count = solution.estimate, len(sighting)
    partials = np.concatenate(
        [
            partials_position(image.camera, image.axes, image.scobj, place)
            for image in sighting.images
        ]
    )
    # An orthonormal basis of what the three columns of the place leave.
    basis = np.linalg.qr(partials, mode="complete")[0][:, 3:]
    by_match, by_state = np.zeros((2, 2 * count, 2 * count))
    for k, spread in enumerate(sighting.state_spread(place)):
        pair = slice(2 * k, 2 * k + 2)
        by_match[pair, pair], by_state[pair, pair] = sighting.covariance[k], spread
    return (
        basis.T @ solution.residuals.ravel(),
        basis.T @ by_match @ basis,
        basis.T @ by_state @ basis,
    )
