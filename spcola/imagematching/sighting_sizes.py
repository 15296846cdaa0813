"""How large errors of matches and of states are, by how images contradict one another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from spcola.arrays import FloatArray
from spcola.camera import partials_position
from spcola.control.estimation import by_position_and_pointing
from spcola.imagematching.sighting import Sighting

# Standard deviation of the logarithms of the factors beforehand: of matches and pointing to e²; of
# positions, which the solution states to stand by, to e.
_WIDTHS = np.array([2.0, 1.0, 2.0])
# Logarithm of a factor that is as good as none.
_SMALLEST = -6.0


class SizeFactors(NamedTuple):
    """Factors on the sigmas of matches, and of the states' positions and pointing.

    Pointing is that at a known position; what turns with the position is in the second.
    """

    match: float
    position: float
    pointing: float


def estimate_factors(sightings: Sequence[Sighting]) -> SizeFactors:
    """Return by what the stated errors of matches and of states are to be multiplied.

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
        1 throughout where nothing tells.
    """
    cases = [_case(sighting) for sighting in sightings if len(sighting) > 1]
    if not cases:
        return SizeFactors(1.0, 1.0, 1.0)

    def cost(logs: FloatArray) -> float:
        squares = np.exp(2.0 * np.clip(logs, _SMALLEST, -_SMALLEST))
        total = float(np.sum((logs / _WIDTHS) ** 2))
        for left, parts in cases:
            root = np.linalg.cholesky(np.tensordot(squares, parts, axes=1))
            white = np.linalg.solve(root, left)
            total += float(white @ white) + 2.0 * float(np.sum(np.log(np.diag(root))))
        return total

    simplex = np.vstack([np.zeros(3), np.diag([0.7, -0.4, -0.7])])
    found = minimize(
        cost,
        simplex[0],
        method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 0.02, "maxiter": 200, "initial_simplex": simplex},
    )
    match, position, pointing = np.exp(np.clip(found.x, _SMALLEST, -_SMALLEST)).tolist()
    return SizeFactors(match, position, pointing)


def _case(sighting: Sighting) -> tuple[FloatArray, FloatArray]:
    """Residuals (K,) that no place explains, and their covariances (3, K, K) by each factor."""
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
    by_position, by_pointing = by_position_and_pointing(sighting.states)
    parts = [
        sighting.covariance,
        sighting.spread_by(by_position, place),
        sighting.spread_by(by_pointing, place),
    ]
    whole = np.zeros((3, 2 * count, 2 * count))
    for k in range(count):
        pair = slice(2 * k, 2 * k + 2)
        whole[:, pair, pair] = [part[k] for part in parts]
    return basis.T @ solution.residuals.ravel(), basis.T @ whole @ basis
