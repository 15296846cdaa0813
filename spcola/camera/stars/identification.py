"""Which measured star is which of the catalogue, given an approximate attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import poisson

from spcola.arrays import FloatArray, IntArray
from spcola.camera.camera import Camera
from spcola.camera.projection import project_vectors, rotate_axes, turn_partials
from spcola.camera.stars.catalogue import StarCatalogue
from spcola.camera.stars.centroids import StarPositions
from spcola.errors import NotObservableError

# Chance that stars which are no others' agree as often as found.
_MOST_CHANCE = 1e-6
_FEWEST = 3
_ROUNDS = 8
# Stars of the catalogue for each measured one: false stars and variable ones take places too.
_CANDIDATES = 3


@dataclass(frozen=True, eq=False)
class Identified:
    """Stars of one image that were found in the catalogue.

    Parameters
    ----------
    measured : (M,) ndarray of int
        Their places among the measured positions.
    catalogue : (M,) ndarray of int
        Their places in the catalogue.
    axes : (3, 3) ndarray
        Rows Cx, Cy, Cz, inertial: the attitude after the match.
    chance : float
        Probability that as many agree by chance.
    """

    measured: IntArray
    catalogue: IntArray
    axes: FloatArray
    chance: float


def identify(
    camera: Camera,
    axes: FloatArray,
    stars: StarPositions,
    sky: StarCatalogue,
    *,
    search_px: float = 50.0,
    match_px: float = 3.0,
) -> Identified:
    """Identify the stars of an image.

    Of all differences between measured and predicted places, the one with most others about it is
    the shift of the attitude. Stars that are one another's nearest within a tolerance that shrinks
    to `match_px` then turn the attitude, until nothing changes.

    Parameters
    ----------
    camera : Camera
        Nominal; good to `match_px` over the field.
    axes : (3, 3) ndarray
        Approximate attitude, rows inertial: its direction good to `search_px`, its twist to
        `match_px` at the edge of the field.
    stars : StarPositions
        Measured.
    sky : StarCatalogue
        Apparent directions of the catalogue's stars. Of those in the field the brightest are used,
        three for each measured star.
    search_px, match_px : float
        Pixels.

    Raises
    ------
    NotObservableError
        If fewer than three stars agree, or as many as found may do so by chance.
    """
    measured = np.column_stack([stars.pixel, stars.line])
    directions = sky.directions
    near = _in_field(camera, axes, directions, search_px)
    near = _brightest(sky, near, _CANDIDATES * max(len(measured), _FEWEST))
    if min(len(measured), len(near)) < _FEWEST:
        counts = f"{len(measured)} stars measured, {len(near)} of the catalogue in the field"
        raise _unidentified(f"{counts}: three at least are needed")
    turned = _shifted(camera, axes, measured, directions[near], (search_px, match_px))
    pairs = np.zeros((0, 2), dtype=int)
    for number in range(_ROUNDS):
        predicted = np.column_stack(project_vectors(camera, directions[near] @ turned.T))
        tolerance = match_px * max(1.0, 2.0 - 0.5 * number)
        new = _agreeing(measured, predicted, tolerance)
        if number > 2 and np.array_equal(new, pairs):
            break
        pairs = new
        turned = _turned(camera, turned, measured[pairs[:, 0]], directions[near[pairs[:, 1]]])
    chance = _chance(camera, len(measured), len(near), len(pairs), (search_px, match_px))
    if chance > _MOST_CHANCE:
        raise _unidentified(
            f"{len(pairs)} of {len(measured)} stars agree with the catalogue, as may happen by "
            f"chance ({chance:.1g})"
        )
    return Identified(pairs[:, 0], near[pairs[:, 1]], turned, chance)


def _agreeing(measured: FloatArray, predicted: FloatArray, tolerance: float) -> IntArray:
    """Return the pairs (N, 2) of stars that are one another's nearest, at least three."""
    pairs = _mutual(measured, predicted, tolerance)
    if len(pairs) < _FEWEST:
        raise _unidentified(
            f"{len(pairs)} stars agree within {tolerance:g} pixels: three at least are needed"
        )
    return pairs


def _brightest(sky: StarCatalogue, near: IntArray, count: int) -> IntArray:
    """Return the places (N,) of the brightest stars of those near, at most `count`."""
    order = np.argsort(sky.magnitudes[near], kind="stable")
    chosen: IntArray = near[order[:count]]
    return chosen


def _unidentified(what: str) -> NotObservableError:
    return NotObservableError(what, where="star identification")


def _in_field(camera: Camera, axes: FloatArray, directions: FloatArray, margin: float) -> IntArray:
    """Return the places of stars that lie on the detector, or by a margin (pixels) around it."""
    pixel, line = project_vectors(camera, directions @ axes.T)
    with np.errstate(invalid="ignore"):
        inside = (pixel > 0.5 - margin) & (pixel < camera.width + 0.5 + margin)
        inside &= (line > 0.5 - margin) & (line < camera.height + 0.5 + margin)
    return np.flatnonzero(inside)


def _shifted(
    camera: Camera,
    axes: FloatArray,
    measured: FloatArray,
    directions: FloatArray,
    search_match: tuple[float, float],
) -> FloatArray:
    """Return axes (3, 3) turned so that most predicted places agree with measured ones."""
    search, match = search_match
    predicted = np.column_stack(project_vectors(camera, directions @ axes.T))
    shift = (measured[:, None] - predicted[None]).reshape(-1, 2)
    shift = shift[np.max(np.abs(shift), axis=1) <= search]
    if not len(shift):
        return axes
    # The shift with most others about it: a histogram without the edges of cells.
    tree = cKDTree(shift)
    friends = tree.query_ball_point(shift, 2.0 * match, return_length=True)
    center = shift[int(np.argmax(friends))]
    best = shift[np.linalg.norm(shift - center, axis=1) <= 2.0 * match].mean(axis=0)
    slope = turn_partials(camera, np.array([0.0, 0.0, 1.0]))[:, :2]
    return rotate_axes(axes, [*np.linalg.solve(slope, best), 0.0])


def _mutual(one: FloatArray, two: FloatArray, tolerance: float) -> IntArray:
    """Return pairs (M, 2) of places that are one another's nearest within a tolerance."""
    distance, nearest = cKDTree(two).query(one)
    there, back = np.asarray(nearest), np.asarray(cKDTree(one).query(two)[1])
    pairs = np.flatnonzero((distance <= tolerance) & (back[there] == np.arange(len(one))))
    return np.column_stack([pairs, there[pairs]])


def _turned(
    camera: Camera, axes: FloatArray, measured: FloatArray, directions: FloatArray
) -> FloatArray:
    """Return axes (3, 3) after one step of least squares on matched stars, weighted by misses."""
    seen = directions @ axes.T
    predicted = np.column_stack(project_vectors(camera, seen))
    miss = measured - predicted
    size = np.linalg.norm(miss - np.median(miss, axis=0), axis=1)
    weight = 1.0 / (1.0 + (size / max(float(np.median(size)), 1e-3)) ** 2)
    slopes = turn_partials(camera, seen)
    normal = np.einsum("n,nki,nkj->ij", weight, slopes, slopes)
    right = np.einsum("n,nki,nk->i", weight, slopes, miss)
    return rotate_axes(axes, np.linalg.lstsq(normal, right, rcond=1e-12)[0])


def _chance(
    camera: Camera, measured: int, near: int, found: int, search_match: tuple[float, float]
) -> float:
    """Return the probability that as many stars agree with unrelated ones at some shift."""
    search, match = search_match
    area = (camera.width + 2 * search) * (camera.height + 2 * search)
    expected = measured * near * np.pi * match**2 / area
    trials = max(1.0, (search / match) ** 2)
    return float(min(1.0, trials * poisson.sf(found - 1, expected)))
