"""Matches of mapolas by both observation types, topography and images, as rows of one fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.estimation.verdict import Cause
from fusion.registration.fit import LandmarkErrors, MatchedMapolas
from fusion.registration.observations.by_images import ImagedMapolas
from fusion.surfacematch import Match
from spcola.arrays import FloatArray


@dataclass(frozen=True)
class ObservationTypeSizes:
    """Error size, per component, metres, of the centres from each observation type.

    In addition to the covariances of the matches. For topography it is the error of a maplet's
    centre; for images the error of the rendering that the images of one mapola share: albedo, and
    relief that the mapola lacks.
    """

    topography: float
    images: float


@dataclass(frozen=True, eq=False)
class JointMatches:
    """Two matches for each of N mapolas.

    Attributes
    ----------
    rows : MatchedMapolas
        2N rows, those by topography first; covariances include the error sizes of their type.
    effects : (2N, 3, M) ndarray
        Displacement of each by the error patterns of image states: 0 for topography.
    common : (2N, 3, 1) ndarray
        The same for the error shared by all images.
    chi2 : (N,) ndarray
        Squared difference of both types over its covariance, three degrees of freedom; NaN where
        one is missing.
    """

    rows: MatchedMapolas
    effects: FloatArray
    common: FloatArray
    chi2: FloatArray


def joint_matches(
    topography: MatchedMapolas,
    images: ImagedMapolas,
    sizes: ObservationTypeSizes,
    *,
    reject: float = 5.0,
) -> JointMatches:
    """Combine two matches of each mapola as separate rows.

    If they were averaged first, the shared errors of images would enter all rows, and images, which
    are more accurate for a single mapola, would dominate the scale, which all heights together
    determine better.

    The residual covariance of scans displaces both matches of a mapola. Both rows get twice this
    covariance, half the weight each.

    Parameters
    ----------
    topography : MatchedMapolas
        N mapolas.
    images : ImagedMapolas
        The same mapolas, in the same order.
    sizes : ObservationTypeSizes
    reject : float
        If both types differ by more standard deviations, √(χ²/3), one of the matches is wrong and
        neither is used.
    """
    ground = [
        _with_covariance(match, sizes.topography**2 * np.eye(3)) for match in topography.matches
    ]
    imaged = [_with_covariance(match, sizes.images**2 * np.eye(3)) for match in images.matches]
    chi2 = np.full(len(ground), np.nan)
    for row, own in enumerate(topography.residual_covariance):
        if not (ground[row].usable and imaged[row].usable):
            continue
        chi2[row] = _difference(ground[row], imaged[row], _shared(topography, images, row))
        ground[row] = _with_covariance(ground[row], own)
        imaged[row] = _with_covariance(imaged[row], own)
        if chi2[row] > 3.0 * reject**2:
            far = f"topography and images differ by {np.sqrt(chi2[row] / 3.0):.1f} sigma"
            ground[row] = ground[row].refused(Cause.TYPES_DISAGREE, far)
            imaged[row] = imaged[row].refused(Cause.TYPES_DISAGREE, far)
    rows = replace(
        topography,
        matches=[*ground, *imaged],
        effects=np.concatenate([topography.effects] * 2),
        residual_covariance=np.concatenate([topography.residual_covariance] * 2),
        landmarks=_of_topography(topography.landmarks),
    )
    effects, common = (
        np.concatenate([np.zeros_like(group), group]) for group in (images.effects, images.common)
    )
    return JointMatches(rows, effects, common, chi2)


def _with_covariance(match: Match, covariance: FloatArray) -> Match:
    """Return a match with another covariance (3, 3) added to its own."""
    return replace(match, covariance=match.covariance + covariance)


def _shared(
    topography: MatchedMapolas, images: ImagedMapolas, row: int
) -> tuple[FloatArray, FloatArray]:
    """Estimated error (3,) of a mapola's landmark, and covariance (3, 3) of the shared errors."""
    spread = images.effects[row] @ images.effects[row].T
    landmarks = topography.landmarks
    if landmarks is None:
        return np.zeros(3), spread
    shared = landmarks.shared[row]
    return landmarks.offset[row], spread + landmarks.own[row] + shared @ shared.T


def _difference(ground: Match, imaged: Match, shared: tuple[FloatArray, FloatArray]) -> float:
    """Squared difference of two matches over its covariance."""
    offset, spread = shared
    apart = imaged.displacement - (ground.displacement - offset)
    return float(apart @ np.linalg.solve(ground.covariance + imaged.covariance + spread, apart))


def _of_topography(landmarks: LandmarkErrors | None) -> LandmarkErrors | None:
    """Return errors of landmarks for both types: 0 for images, which are not matched to maplets."""
    if landmarks is None:
        return None
    return replace(
        landmarks,
        offset=np.concatenate([landmarks.offset, np.zeros_like(landmarks.offset)]),
        own=np.concatenate([landmarks.own, np.zeros_like(landmarks.own)]),
        shared=np.concatenate([landmarks.shared, np.zeros_like(landmarks.shared)]),
    )
