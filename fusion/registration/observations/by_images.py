"""Matches of mapolas by images: centres by the landmark equations, with shared errors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.estimation.verdict import Cause
from fusion.surfacematch import Match
from spcola.arrays import FloatArray
from spcola.control.estimation import LandmarkSolution, state_partials
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid
from spcola.imagematching import Sighting, SizeFactors, agreeing, estimate_factors
from spcola.math.statistics import covariance_root

# An error pattern of an image's state that displaces the mapolas by less (root of the sum of
# squares, metres) counts as an independent error of each mapola; so do those beyond the maximum
# number.
_LEAST = 1e-3
_MOST_PATTERNS = 300
# Error common to all images, pixels: a scale of the body.
_OUTWARD_PX = 0.003
# Number of sightings from which error sizes are estimated; more would hardly change them.
_SAMPLE = 128
# Images that a mapola needs.
_FEWEST_IMAGES = 2


@dataclass(frozen=True, eq=False)
class ImagedMapolas:
    """Matches by images of all mapolas, including those that no image shows.

    Attributes
    ----------
    matches : tuple of Match
        N displacements of the mapolas to their positions from images. The covariance is that of the
        matches in the images; the errors of image states are in `effects`.
    sightings : tuple of Sighting
        Those images, their sigmas multiplied by the factors.
    effects : (N, 3, M) ndarray
        Displacements of the mapolas, metres, by each pattern of the states' errors, of standard
        deviation 1.
    common : (N, 3, 1) ndarray
        The same for the radial error shared by all images. Images do not separate it from a scale:
        it changes sigmas, but no estimate.
    factors : SizeFactors
        Factors applied to sigmas of matches, positions and pointing.
    """

    matches: tuple[Match, ...]
    sightings: tuple[Sighting, ...]
    effects: FloatArray
    common: FloatArray
    factors: SizeFactors


def place_mapolas(grids: Sequence[MapletGrid], sightings: Sequence[Sighting]) -> ImagedMapolas:
    """Solve the centres of mapolas from their positions in images [9, 10].

    The error sizes of matches and of states are estimated from the residuals of all mapolas; each
    centre is then solved with these sizes.

    Parameters
    ----------
    grids : sequence of N MapletGrid
        Of the mapolas, in lidar coordinates.
    sightings : sequence of N Sighting
    """
    sample = sightings[:: max(1, -(-len(sightings) // _SAMPLE))]
    rough = estimate_factors(sample)
    factors = estimate_factors([_scaled_back(agreeing(s.scaled(*rough)), rough) for s in sample])
    scaled = tuple(agreeing(sighting.scaled(*factors)) for sighting in sightings)
    solved = [_solved(sighting) for sighting in scaled]
    effects, rest = _shared(scaled, solved)
    matches = tuple(
        _match(grid, sighting, solution, own)
        for grid, sighting, solution, own in zip(grids, scaled, solved, rest, strict=True)
    )
    return ImagedMapolas(matches, scaled, effects, _common(grids, scaled), factors)


def _common(grids: Sequence[MapletGrid], sightings: Sequence[Sighting]) -> FloatArray:
    """Displacement of each mapola (N, 3, 1), metres, by the error that all images share."""
    centers = np.array([grid.center for grid in grids])
    pixels = [
        image.camera.pixel_angle * float(np.linalg.norm(image.position - grid.center))
        for grid, sighting in zip(grids, sightings, strict=True)
        for image in sighting.images
    ]
    reach = float(np.sqrt(np.mean(np.sum(centers**2, axis=1))))
    size = _OUTWARD_PX * float(np.median(pixels)) / reach if pixels else 0.0
    outward: FloatArray = size * centers[:, :, None]
    return outward


def _scaled_back(sighting: Sighting, factors: SizeFactors) -> Sighting:
    return sighting.scaled(*(1.0 / factor for factor in factors))


def _solved(sighting: Sighting) -> LandmarkSolution | None:
    """Return the centre; None if the images do not determine it."""
    if len(sighting) < _FEWEST_IMAGES:
        return None
    try:
        solution = sighting.solve()
    except NotObservableError:
        return None
    return solution if solution.converged else None


def _shared(
    sightings: Sequence[Sighting], solved: Sequence[LandmarkSolution | None]
) -> tuple[FloatArray, FloatArray]:
    """Error patterns of states at N mapolas (N, 3, M), and residual covariance (N, 3, 3).

    The patterns of one image's six state errors are principal components of the displacements of
    the mapolas.
    """
    displaced: dict[str, dict[int, FloatArray]] = {}
    for row, (sighting, solution) in enumerate(zip(sightings, solved, strict=True)):
        if solution is None:
            continue
        for k, image in enumerate(sighting.images):
            rows = solution.gain[k] @ state_partials(image, solution.estimate)
            displaced.setdefault(image.name, {})[row] = rows @ covariance_root(sighting.states[k])
    patterns: list[tuple[float, tuple[int, ...], FloatArray]] = []
    residual_covariance = np.zeros((len(sightings), 3, 3))
    for by_row in displaced.values():
        moved = np.array(list(by_row.values()))
        square, directions = np.linalg.eigh(np.einsum("nip,niq->pq", moved, moved))
        turned = moved @ directions
        patterns += [(square[k], tuple(by_row), turned[:, :, k]) for k in range(len(square))]
    patterns.sort(key=lambda pattern: -pattern[0])
    kept = [pattern for pattern in patterns[:_MOST_PATTERNS] if pattern[0] > _LEAST**2]
    effects = np.zeros((len(sightings), 3, len(kept)))
    for column, (_, rows, moved) in enumerate(kept):
        effects[list(rows), :, column] = moved
    for _, rows, moved in patterns[len(kept) :]:
        residual_covariance[list(rows)] += moved[:, :, None] * moved[:, None, :]
    return effects, residual_covariance


def _match(
    grid: MapletGrid,
    sighting: Sighting,
    solution: LandmarkSolution | None,
    residual_covariance: FloatArray,
) -> Match:
    """Convert a solved centre to a match like that by topography."""
    coverage = float(np.max(sighting.share)) if len(sighting) else 0.0
    match = Match.failed(sighting.name, grid, coverage, Cause.NOT_IN_IMAGES, _why(sighting))
    if len(sighting):
        match = replace(match, correlation=float(np.median(sighting.correlation)))
    if solution is None:
        return match
    displacement, gain = solution.estimate - grid.center, solution.gain
    own = np.einsum("nia,nab,njb->ij", gain, sighting.covariance, gain)
    return replace(
        match,
        displacement=displacement,
        covariance=own + residual_covariance,
        local=grid.axes @ displacement,
        iterations=solution.iterations,
        reason="",
        cause=None,
    )


def _why(sighting: Sighting) -> str:
    """Return why images do not determine the position."""
    if len(sighting):
        return f"{len(sighting)} image(s) do not determine its position"
    if not sighting.left_out:
        return "no image shows it"
    usual, count = Counter(sighting.left_out.values()).most_common(1)[0]
    return f"none of {len(sighting.left_out)} images matches ({count} of them: {usual})"
