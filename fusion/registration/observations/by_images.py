"""Matches of mapolas by images: centres by the landmark equations, and what images share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.surfacematch import Match
from spcola.arrays import FloatArray
from spcola.control.estimation import LandmarkSolution, state_partials
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid
from spcola.imagematching import Sighting, SizeFactors, agreeing, estimate_factors

# A pattern of an image's state that displaces the mapolas by less, root of the sum of squares,
# metres, counts as an error that each mapola has of its own; and so do all beyond so many.
_LEAST = 1e-3
_MOST_PATTERNS = 300
# What all images may get wrong alike, pixels: as if the body were larger or smaller.
_OUTWARD_PX = 0.003
# Sightings that tell how large errors are; more would not change the two numbers by much.
_SAMPLE = 128


@dataclass(frozen=True, eq=False)
class ImagedMapolas:
    """All mapolas, those that no image shows too.

    Attributes
    ----------
    matches : tuple of Match
        N of them: displacement to where the images have the mapola. The covariance is that of the
        matches in the images; what the errors of states do is in `effects`.
    sightings : tuple of Sighting
        Those images, their sigmas times the factors.
    effects : (N, 3, M) ndarray
        What patterns of the states' errors, each of standard deviation 1, do to each mapola,
        metres.
    common : (N, 3, 1) ndarray
        The same of an error that all images share, outward: no image tells it from a scale, and no
        estimate, only its sigma, is changed by it.
    factors : SizeFactors
        By which sigmas of matches, positions and pointing were multiplied.
    """

    matches: tuple[Match, ...]
    sightings: tuple[Sighting, ...]
    effects: FloatArray
    common: FloatArray
    factors: SizeFactors


def place_mapolas(
    grids: Sequence[MapletGrid], sightings: Sequence[Sighting], *, least_images: int = 2
) -> ImagedMapolas:
    """Solve the centres of mapolas from where images show them [9, 10].

    How large errors of matches and of states are is taken from how the images contradict one
    another, over all mapolas; each centre is then solved by these.

    Parameters
    ----------
    grids : sequence of N MapletGrid
        Of the mapolas, in lidar coordinates.
    sightings : sequence of N Sighting
    least_images : int
        That a mapola needs.
    """
    sample = sightings[:: max(1, -(-len(sightings) // _SAMPLE))]
    rough = estimate_factors(sample)
    factors = estimate_factors([_scaled_back(agreeing(s.scaled(*rough)), rough) for s in sample])
    scaled = tuple(agreeing(sighting.scaled(*factors)) for sighting in sightings)
    solved = [_solved(sighting, least_images) for sighting in scaled]
    effects, beside = _shared(scaled, solved)
    matches = tuple(
        _match(grid, sighting, solution, more)
        for grid, sighting, solution, more in zip(grids, scaled, solved, beside, strict=True)
    )
    return ImagedMapolas(matches, scaled, effects, _common(grids, scaled), factors)


def _common(grids: Sequence[MapletGrid], sightings: Sequence[Sighting]) -> FloatArray:
    """What an error that all images share does to each mapola (N, 3, 1), metres."""
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


def _solved(sighting: Sighting, least: int) -> LandmarkSolution | None:
    """Return the centre; None where the images do not give it."""
    if len(sighting) < least:
        return None
    try:
        solution = sighting.solve()
    except NotObservableError:
        return None
    return solution if solution.converged else None


def _shared(
    sightings: Sequence[Sighting], solved: Sequence[LandmarkSolution | None]
) -> tuple[FloatArray, FloatArray]:
    """Patterns of the states' errors at N mapolas (N, 3, M), and the covariance (N, 3, 3) beside.

    The errors of one image's state are those of its six numbers, turned so that each pattern
    displaces the mapolas by as much as it can.
    """
    felt: dict[str, dict[int, FloatArray]] = {}
    for row, (sighting, solution) in enumerate(zip(sightings, solved, strict=True)):
        if solution is None:
            continue
        for k, image in enumerate(sighting.images):
            rows = solution.gain[k] @ state_partials(image, solution.estimate)
            felt.setdefault(image.name, {})[row] = rows @ _root(sighting.states[k])
    patterns: list[tuple[float, tuple[int, ...], FloatArray]] = []
    beside = np.zeros((len(sightings), 3, 3))
    for by_row in felt.values():
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
        beside[list(rows)] += moved[:, :, None] * moved[:, None, :]
    return effects, beside


def _root(covariance: FloatArray) -> FloatArray:
    """Return R (6, 6) with R Rᵀ = `covariance`, of radians and metres."""
    unit = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    root: FloatArray = unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _match(
    grid: MapletGrid,
    sighting: Sighting,
    solution: LandmarkSolution | None,
    beside: FloatArray,
) -> Match:
    """Turn a solved centre into a match like that by topography."""
    unknown = np.full(3, np.nan)
    displacement, covariance, iterations = unknown, np.full((3, 3), np.nan), 0
    if solution is not None:
        displacement, iterations = solution.estimate - grid.center, solution.iterations
        gain = solution.gain
        covariance = np.einsum("nia,nab,njb->ij", gain, sighting.covariance, gain) + beside
    none = float("nan")
    return Match(
        name=sighting.name,
        center=grid.center,
        displacement=displacement,
        covariance=covariance,
        local=grid.axes @ displacement,
        residual=np.full(grid.shape, np.nan),
        correlation=float(np.median(sighting.correlation)) if len(sighting) else none,
        coverage=float(np.max(sighting.share)) if len(sighting) else 0.0,
        iterations=iterations,
        reason="" if solution is not None else _why(sighting),
    )


def _why(sighting: Sighting) -> str:
    """Say why images do not give the place."""
    if len(sighting):
        return f"{len(sighting)} image(s) do not give its place"
    if not sighting.left_out:
        return "no image shows it"
    usual, count = Counter(sighting.left_out.values()).most_common(1)[0]
    return f"none of {len(sighting.left_out)} images matches ({count} of them: {usual})"
