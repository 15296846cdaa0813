"""Sizes of the errors of matches and of states, from disagreements between images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import partials_position
from spcola.control.estimation import by_position_and_pointing
from spcola.imagematching.sighting import Sighting
from spcola.math.statistics import most_likely_sizes

# Prior standard deviation of the logarithms of the factors: of matches and pointing a factor e²; of
# positions, whose sigmas the solution states, e.
_WIDTHS = np.array([2.0, 1.0, 2.0])
# Bound of the logarithms of factors, and first steps of the search.
_REACH = 6.0
_STEPS = np.array([0.7, -0.4, -0.7])


class SizeFactors(NamedTuple):
    """Factors on the sigmas of matches, and of the states' positions and pointing.

    Pointing is that at a known position; its part correlated with position is in the second.

    Parameters
    ----------
    match, position, pointing : float
    """

    match: float
    position: float
    pointing: float


def estimate_factors(sightings: Sequence[Sighting]) -> SizeFactors:
    """Return the factors by which the stated errors of matches and of states are to be multiplied.

    N images give 2N numbers for the three of a place. The redundant ones, over all sightings,
    determine the sizes of errors by the restricted likelihood of Patterson & Thompson (1971), with
    a log-normal prior about 1. Sightings are taken as independent, although the errors of one image
    at two of them are not: the estimates are valid, only less precise than they appear.

    Parameters
    ----------
    sightings : sequence of Sighting
        Those in fewer than two images are not used.

    Returns
    -------
    SizeFactors
        1 throughout where there is no redundancy.
    """
    cases = [_case(sighting) for sighting in sightings if len(sighting) > 1]
    if not cases:
        return SizeFactors(1.0, 1.0, 1.0)

    def deviance(factors: FloatArray) -> float:
        total = 0.0
        for left, parts in cases:
            root = np.linalg.cholesky(np.tensordot(factors**2, parts, axes=1))
            white = np.linalg.solve(root, left)
            total += float(white @ white) + 2.0 * float(np.sum(np.log(np.diag(root))))
        return total

    found = most_likely_sizes(
        deviance,
        np.ones(3),
        width=_WIDTHS,
        start=np.ones(3),
        steps=_STEPS,
        reach=_REACH,
        tolerance=(0.02, 0.02),
    )
    return SizeFactors(*found.tolist())


def _case(sighting: Sighting) -> tuple[FloatArray, FloatArray]:
    """Residuals (K,) not absorbed by the place, and their covariances (3, K, K) by each factor."""
    solution = sighting.solve()
    place, count = solution.estimate, len(sighting)
    partials = np.concatenate([partials_position(image, place) for image in sighting.images])
    # An orthonormal basis of the complement of the three columns of the place.
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
