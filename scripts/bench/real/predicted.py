"""Brightness that maplets predict for an image that they were not solved from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from real.places import latitude_longitude
from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage
from spcola.grids import Maplet
from spcola.imagematching import ChoiceOptions, choose_images
from spcola.photometry import view_of
from spcola.photometry.expected_pixels import expected_pixels
from spcola.photometry.functions import PhotometricFunction
from spcola.photometry.ground import at_cells
from spcola.shape import RayCaster

# Fewest pixels that are compared, and the least share of a maplet in the frame.
FEWEST, SHARE = 300, 0.5
# Shifts that are tried for the best correlation, pixels.
_SHIFTS = np.arange(-1.0, 1.01, 0.25)
_MARGIN = 4


@dataclass(frozen=True)
class Score:
    """How a prediction fits an image.

    Parameters
    ----------
    given, best : float
        Correlation at the image's state, and at the best shift of up to a pixel each way.
    residual : float
        Root mean square of what is left at the state, with the best scale, relative.
    """

    given: float
    best: float
    residual: float

    @property
    def unexplained(self) -> float:
        """Share of the brightness' variance that the prediction leaves, at the best shift."""
        return 1.0 - max(self.best, 0.0) ** 2


@dataclass(frozen=True, eq=False)
class Pair:
    """A left-out image and a maplet, as it was at the start and as it was solved.

    Parameters
    ----------
    image, maplet : str
    latitude, longitude : float
        Of the maplet, degrees, east.
    pixels : int
        That were compared.
    start, solved : Score
    pictures : three (H, W) ndarrays
        The image and both predictions, in the image's numbers; NaN where not compared.
    """

    image: str
    maplet: str
    latitude: float
    longitude: float
    pixels: int
    start: Score
    solved: Score
    pictures: tuple[FloatArray, FloatArray, FloatArray]

    @property
    def gain(self) -> float:
        """Unexplained variance of the start less that of the solution."""
        return self.start.unexplained - self.solved.unexplained


def pairs_of(
    images: Sequence[SpcImage],
    start: Mapping[str, Maplet],
    solved: Mapping[str, Maplet],
    caster: RayCaster | None,
    function: PhotometricFunction,
) -> Iterator[Pair]:
    """Yield all left-out images with the maplets that they show."""
    for image in images:
        for name, maplet in solved.items():
            if not choose_images(maplet.grid, [image], options=ChoiceOptions(least_share=SHARE)):
                continue
            pair = _compared(image, start[name], maplet, caster, function)
            if pair is not None:
                yield pair


def _compared(
    image: SpcImage,
    start: Maplet,
    solved: Maplet,
    caster: RayCaster | None,
    function: PhotometricFunction,
) -> Pair | None:
    assert image.pixels is not None
    dn = np.asarray(image.pixels, dtype=np.float64)
    layers = [_predicted(image, one, caster, function) for one in (start, solved)]
    low, high = image.thresholds
    used = (layers[0] > 0.0) & (layers[1] > 0.0) & (dn > low) & (dn < high)
    if np.count_nonzero(used) < FEWEST:
        return None
    rows, columns = np.nonzero(used)
    window = tuple(
        slice(max(int(one.min()) - _MARGIN, 0), int(one.max()) + _MARGIN + 1)
        for one in (rows, columns)
    )
    part, mask = dn[window], used[window]
    parts = [layer[window] for layer in layers]
    scores = [_score(part, layer, mask) for layer in parts]
    shown = [part, *(layer * _scale(part[mask], layer[mask]) for layer in parts)]
    return Pair(
        image.name, solved.name, *latitude_longitude(solved.grid.center),
        int(np.count_nonzero(mask)), *scores,
        tuple(np.where(mask, layer, np.nan) for layer in shown),
    )  # fmt: skip


def _predicted(
    image: SpcImage, maplet: Maplet, caster: RayCaster | None, function: PhotometricFunction
) -> FloatArray:
    """Return the relative brightness (NLN, NPX) of a maplet in an image; NaN elsewhere."""
    camera = image.camera
    whole = np.full((camera.height, camera.width), np.nan)
    view = view_of(image, maplet.grid, maplet.height, beyond=caster)
    albedo = np.where(np.isfinite(maplet.albedo), maplet.albedo, np.nanmean(maplet.albedo))
    value = function(view.cos_incidence, view.cos_emission, view.phase) * at_cells(albedo)
    lit = at_cells(np.where(np.isfinite(view.pixel), view.lit, np.nan))
    seen = at_cells(view.seen.astype(np.float64)) > 0.99
    value = np.where(np.isfinite(view.cos_incidence) & seen, value * lit, np.nan)
    expected = expected_pixels(view, value)
    if not expected.known.any():
        return whole
    row, column = np.nonzero(expected.known)
    places = row + int(expected.first[0]), column + int(expected.first[1])
    inside = (places[0] >= 0) & (places[0] < camera.height)
    inside &= (places[1] >= 0) & (places[1] < camera.width)
    whole[places[0][inside], places[1][inside]] = expected.value[row[inside], column[inside]]
    return whole


def _score(dn: FloatArray, expected: FloatArray, mask: BoolArray) -> Score:
    values = expected[mask]
    given = _correlation(dn[mask], values)
    best = given
    coefficients = ndimage.spline_filter(dn, order=3)
    for down in _SHIFTS:
        for right in _SHIFTS:
            moved = ndimage.shift(
                coefficients, (down, right), order=3, mode="nearest", prefilter=False
            )
            best = max(best, _correlation(moved[mask], values))
    left = dn[mask] - _scale(dn[mask], values) * values
    return Score(given, best, float(np.sqrt(np.mean(left**2)) / dn[mask].mean()))


def _scale(dn: FloatArray, expected: FloatArray) -> float:
    return float(dn @ expected) / float(expected @ expected)


def _correlation(one: FloatArray, other: FloatArray) -> float:
    a, b = one - one.mean(), other - other.mean()
    below = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / below if below > 0.0 else 0.0
