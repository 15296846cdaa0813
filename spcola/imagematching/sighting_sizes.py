"""Sizes of the errors of matches and of states, from disagreements between images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import partials_position
from spcola.control.estimation import by_position_and_pointing
from spcola.imagematching.sighting import Sighting
from spcola.math.statistics import SizeLikelihood, most_likely_sizes

# Prior standard deviation of the logarithms of the factors: of matches and pointing a factor e²; of
# positions, whose sigmas the solution states, e.
_WIDTHS = np.array([2.0, 1.0, 2.0])

# Residuals (K,) of a sighting, and their covariances (3, K, K) by each factor.
_Case = tuple[FloatArray, FloatArray]


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

    found = most_likely_sizes(
        lambda factors: _likelihood(cases, factors), np.ones(3), width=_WIDTHS, start=np.ones(3)
    )
    return SizeFactors(*found.tolist())


def _likelihood(cases: Sequence[_Case], factors: FloatArray) -> SizeLikelihood:
    """Likelihood of three factors, of residuals and their covariances by each."""
    deviance, gradient, information = 0.0, np.zeros(3), np.zeros((3, 3))
    for left, parts in cases:
        # ∂V/∂ ln f, of a covariance V = Σ f² parts.
        changes = 2.0 * (factors**2)[:, None, None] * parts
        inverse_root = np.linalg.inv(np.linalg.cholesky(0.5 * changes.sum(axis=0)))
        white = inverse_root @ left
        changes = inverse_root @ changes @ inverse_root.T
        working = changes @ white
        deviance += float(white @ white) - 2.0 * float(np.sum(np.log(np.diag(inverse_root))))
        gradient += np.trace(changes, axis1=1, axis2=2) - working @ white
        information += working @ working.T
    return SizeLikelihood(deviance, gradient, information)


def _case(sighting: Sighting) -> _Case:
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
