"""Both kinds of match of a mapola, by topography and by images, as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.registration.by_images import ImagedMapolas
from fusion.registration.match import Match
from spcola.arrays import FloatArray
from spcola.maplet import MapletGrid


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
class CombinedMatches:
    """One match for each mapola.

    Attributes
    ----------
    matches : tuple of Match
        N of them; their covariances hold the error sizes of their kinds.
    effects : (N, 3, M) ndarray
        What is left of the patterns of the images' states in each.
    chi2 : (N,) ndarray
        Squared difference of both kinds over its covariance, three degrees of freedom; NaN where
        there is one kind.
    """

    matches: tuple[Match, ...]
    effects: FloatArray
    chi2: FloatArray


def combine(
    grids: Sequence[MapletGrid],
    topography: Sequence[Match],
    images: ImagedMapolas,
    sizes: KindSizes,
    *,
    reject: float = 5.0,
) -> CombinedMatches:
    """Join two matches of each mapola by their information.

    Parameters
    ----------
    grids : sequence of N MapletGrid
        Of the mapolas.
    topography : sequence of N Match
    images : ImagedMapolas
        Of the same mapolas, in their order.
    sizes : KindSizes
    reject : float
        Two kinds that differ by more standard deviations, √(χ²/3), contradict each other: one of
        them has found something else, and neither is used.

    Returns
    -------
    CombinedMatches
        Where one kind is not usable, the other alone.
    """
    shared = images.effects
    left, chi2 = np.zeros_like(shared), np.full(len(topography), np.nan)
    matches = []
    for row, (grid, ground, seen) in enumerate(zip(grids, topography, images.matches, strict=True)):
        known = [_covered(ground, sizes.topography), _covered(seen, sizes.images)]
        if not (ground.usable and seen.usable):
            left[row] = shared[row] if seen.usable else 0.0
            matches.append(known[1] if seen.usable else known[0])
            continue
        apart = known[1].displacement - known[0].displacement
        alone = known[0].covariance + known[1].covariance
        variance = alone + shared[row] @ shared[row].T
        chi2[row] = float(apart @ np.linalg.solve(variance, apart))
        share = np.linalg.solve(variance, known[0].covariance).T
        left[row] = share @ shared[row]
        joined = _joined(grid, known[0], known[1], share)
        if chi2[row] > 3.0 * reject**2:
            off = np.sqrt(chi2[row] / 3.0)
            joined = replace(joined, reason=f"topography and images differ by {off:.1f} sigma")
        matches.append(joined)
    return CombinedMatches(tuple(matches), left, chi2)


def _covered(match: Match, size: float) -> Match:
    """Return a match whose covariance holds the error size of its kind."""
    return replace(match, covariance=match.covariance + size**2 * np.eye(3))


def _joined(grid: MapletGrid, ground: Match, seen: Match, share: FloatArray) -> Match:
    """Return the match of which `share` (3, 3) is by images, the rest by topography."""
    rest = np.eye(3) - share
    displacement = share @ seen.displacement + rest @ ground.displacement
    return replace(
        ground,
        displacement=displacement,
        covariance=share @ seen.covariance @ share.T + rest @ ground.covariance @ rest.T,
        local=grid.axes @ displacement,
    )
