"""Both kinds of match of a mapola, by topography and by images, as rows of one fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.registration.observations.by_images import ImagedMapolas
from fusion.registration.observations.landmarks import LandmarkErrors
from fusion.registration.results.summary import MatchedMapolas
from fusion.surfacematch import Match
from spcola.arrays import FloatArray


@dataclass(frozen=True)
class KindSizes:
    """Error size, per component, metres, of the centres that each kind of match gives.

    Beyond what the matches know of themselves. By topography it is the error of a maplet's centre;
    by images that of the rendering, which the images of one mapola share: albedo, and relief that
    the mapola does not hold.
    """

    topography: float
    images: float


@dataclass(frozen=True, eq=False)
class JointMatches:
    """Two matches for each of N mapolas.

    Attributes
    ----------
    rows : MatchedMapolas
        2N of them, those by topography first; covariances hold the error sizes of their kinds.
    effects : (2N, 3, M) ndarray
        What patterns of the images' states do to each: nothing to those by topography.
    common : (2N, 3, 1) ndarray
        The same of what all images share.
    chi2 : (N,) ndarray
        Squared difference of both kinds over its covariance, three degrees of freedom; NaN where
        there is one kind.
    """

    rows: MatchedMapolas
    effects: FloatArray
    common: FloatArray
    chi2: FloatArray


def both_kinds(
    topography: MatchedMapolas, images: ImagedMapolas, sizes: KindSizes, *, reject: float = 5.0
) -> JointMatches:
    """Put two matches of each mapola beside each other.

    Joined beforehand they would err together by what images share, and that of both of them which
    a single mapola tells better would hide what all heights together tell better: the scale.

    What scans do to one mapola alone displaces both of its matches. It is counted in both with
    twice its covariance, as if it told half as much.

    Parameters
    ----------
    topography : MatchedMapolas
        N of them.
    images : ImagedMapolas
        Of the same mapolas, in their order.
    sizes : KindSizes
    reject : float
        Two kinds that differ by more standard deviations, √(χ²/3), contradict each other: one of
        them has found something else, and neither is used.
    """
    ground = [_covered(match, sizes.topography**2 * np.eye(3)) for match in topography.matches]
    seen = [_covered(match, sizes.images**2 * np.eye(3)) for match in images.matches]
    chi2 = np.full(len(ground), np.nan)
    for row, beside in enumerate(topography.beside):
        if not (ground[row].usable and seen[row].usable):
            continue
        chi2[row] = _difference(ground[row], seen[row], _beyond(topography, images, row))
        reason = ""
        if chi2[row] > 3.0 * reject**2:
            reason = f"topography and images differ by {np.sqrt(chi2[row] / 3.0):.1f} sigma"
        ground[row] = replace(_covered(ground[row], beside), reason=reason)
        seen[row] = replace(_covered(seen[row], beside), reason=reason)
    rows = replace(
        topography,
        matches=[*ground, *seen],
        effects=np.concatenate([topography.effects] * 2),
        beside=np.concatenate([topography.beside] * 2),
        landmarks=_of_topography(topography.landmarks),
    )
    effects, common = (
        np.concatenate([np.zeros_like(group), group]) for group in (images.effects, images.common)
    )
    return JointMatches(rows, effects, common, chi2)


def _covered(match: Match, covariance: FloatArray) -> Match:
    """Return a match whose covariance holds another (3, 3) too."""
    return replace(match, covariance=match.covariance + covariance)


def _beyond(
    topography: MatchedMapolas, images: ImagedMapolas, row: int
) -> tuple[FloatArray, FloatArray]:
    """What is known to part the kinds of a mapola (3,), and the covariance (3, 3) of the rest."""
    spread = images.effects[row] @ images.effects[row].T
    landmarks = topography.landmarks
    if landmarks is None:
        return np.zeros(3), spread
    shared = landmarks.shared[row]
    return landmarks.offset[row], spread + landmarks.own[row] + shared @ shared.T


def _difference(ground: Match, seen: Match, beyond: tuple[FloatArray, FloatArray]) -> float:
    """Squared difference of two matches over its covariance."""
    offset, spread = beyond
    apart = seen.displacement - (ground.displacement - offset)
    return float(apart @ np.linalg.solve(ground.covariance + seen.covariance + spread, apart))


def _of_topography(landmarks: LandmarkErrors | None) -> LandmarkErrors | None:
    """Return errors of landmarks for both kinds: those by images are matched with no maplet."""
    if landmarks is None:
        return None
    return replace(
        landmarks,
        offset=np.concatenate([landmarks.offset, np.zeros_like(landmarks.offset)]),
        own=np.concatenate([landmarks.own, np.zeros_like(landmarks.own)]),
        shared=np.concatenate([landmarks.shared, np.zeros_like(landmarks.shared)]),
    )
