"""Fusion on ground without images and returns, where only the shape is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fusion.fusing import Constraints, FuseInput, FuseOptions, fuse_maplet
from fusion.fusing.maplets import FusedMaplet, Source
from fusion.fusing.uncertainty import (
    DEFAULT_INFORMATION,
    AlignedHeights,
    ShapeErrors,
    SlopeInformation,
    estimate_information,
    estimate_shape_errors,
)
from fusion.fusing.uncertainty.variogram import mean_square
from spcola.grids import Maplet, MapletGrid

GRID = MapletGrid.facing([80.0, 10.0, 5.0], [1.0, 0.1, 0.1], 0.5, 25)
SIZE = GRID.size
DARK = np.arange(SIZE) >= 20
NOISE = 0.02
SHARED = (0.0, 4.0, 12.0)


def field(generator: np.random.Generator, sigma: float, cells: float) -> np.ndarray:
    """A random surface, correlated over some cells."""
    wide = ndimage.gaussian_filter(generator.normal(size=(3 * SIZE, 3 * SIZE)), cells)
    return sigma * wide[SIZE : 2 * SIZE, SIZE : 2 * SIZE] / wide.std()


def parts(
    seed: int, cells: float, seen: np.ndarray
) -> tuple[np.ndarray, FuseInput, AlignedHeights]:
    """Ground lit on the left; a lidar `seen` in part; 20 cm errors of the shape over `cells`."""
    rng = np.random.default_rng(seed)
    ground = field(rng, 0.5, 5.0) + field(rng, 0.05, 1.0)
    spc = np.where(DARK, np.nan, ground + field(rng, 0.05, 2.0))
    shape = ground + field(rng, 0.2, cells)
    lidar = ground + rng.normal(0.0, NOISE, GRID.shape)
    # The information is of the whole solution: it has seen such ground elsewhere.
    pair = AlignedHeights(lidar, spc, np.full(GRID.shape, NOISE), GRID.gsd, None, shape)
    heights = Constraints(
        np.where(seen, lidar, np.nan),
        np.where(seen, NOISE, np.nan),
        np.where(seen, 3, 0).astype(np.int32),
    )
    whole = FuseInput("A", GRID, Maplet("A", GRID, spc), heights, shape, np.zeros((3, 3)))
    return ground, whole, pair


def fused_of_eight(
    cells: float, seen: np.ndarray
) -> tuple[list[tuple[np.ndarray, FusedMaplet]], SlopeInformation]:
    """Ground and fused maplet of eight seeds, and the information that they share."""
    made = [parts(seed, cells, seen) for seed in range(8)]
    information = estimate_information([pair for _, _, pair in made])
    return [(g, fuse_maplet(p, information).maplet) for g, p, _ in made], information


def shares(made: list[tuple[np.ndarray, FusedMaplet]], where: np.ndarray) -> tuple[float, float]:
    """Shares of the errors within one and two sigma."""
    pulls = np.concatenate([(np.abs(f.height - g) / f.sigma)[where] for g, f in made])
    return float(np.mean(pulls < 1.0)), float(np.mean(pulls < 2.0))


@pytest.mark.parametrize("cells", SHARED)
def test_what_the_shape_errs_by_is_recovered(cells: float) -> None:
    rng = np.random.default_rng(1)
    errors = [field(rng, 0.2, cells) for _ in range(8)]
    found = estimate_shape_errors(errors)
    assert found is not None
    assert found.height_sigma_m == pytest.approx(0.2, rel=0.25)
    first = mean_square(errors, 1)[0][0]
    # Neighbours differ by half of a step's variance; further away it may be more.
    assert found.step_sigma_m >= np.sqrt(2.0 * first) * 0.999
    # A Gaussian of σ leaves the correlation exp(−L²/4σ²): 37 % at 2 σ. Eight are looked at.
    length = np.sqrt(found.correlated_cells / np.pi)
    assert length == pytest.approx(np.clip(2.0 * cells, 1.0, 8.0), abs=1.0)


def test_too_few_heights_give_no_estimate() -> None:
    few = np.full(GRID.shape, np.nan)
    few[:5, :5] = 0.1
    assert estimate_shape_errors([few]) is None
    assert estimate_shape_errors([]) is None
    assert estimate_information([]).shape is None


def test_errors_of_the_shape_are_estimated_where_images_show_nothing() -> None:
    """It is relied upon in the dark, and may be worse there than where it was seen."""
    rng = np.random.default_rng(2)
    ground = field(rng, 0.5, 5.0)
    error = np.where(DARK, 0.5, 0.01) * rng.normal(size=GRID.shape)
    spc = np.where(DARK, np.nan, ground)
    sigma = np.full(GRID.shape, NOISE)
    found = estimate_information(
        [AlignedHeights(ground, spc, sigma, GRID.gsd, None, ground + error)]
    )
    assert found.shape is not None
    assert found.shape.height_sigma_m == pytest.approx(0.5, rel=0.1)
    everywhere = AlignedHeights(ground, ground, sigma, GRID.gsd, None, ground + error)
    lit = estimate_information([everywhere]).shape
    assert lit is not None
    assert lit.height_sigma_m == pytest.approx(0.5 * np.sqrt(DARK.mean()), rel=0.1)


@pytest.mark.parametrize("cells", SHARED)
def test_dark_ground_without_returns_has_a_true_sigma(cells: float) -> None:
    """Independent errors of the shape or a common one; near the lidar and far from it."""
    columns = np.arange(SIZE)
    seen = np.broadcast_to((columns < 30) & ((columns // 3) % 2 == 0), GRID.shape)
    made, _ = fused_of_eight(cells, seen)
    hidden = np.broadcast_to(DARK, GRID.shape) & ~seen
    assert all(np.all(f.source[hidden] == Source.FILLED) for _, f in made)
    near, far = hidden & (columns < 31), hidden & (columns > 38)
    for where in (near, far):
        one, two = shares(made, where)
        assert one > 0.6
        assert two > 0.9
    # Far away the shape is all that is known, and no sigma is larger than its own by much.
    assert all(np.median(f.sigma[far]) < 0.35 for _, f in made)
    assert shares(made, far)[0] < 0.97


@pytest.mark.parametrize("seed", range(4))
def test_an_offset_of_the_shape_makes_no_step_where_a_return_is_missing(seed: int) -> None:
    """0.75 m between shape and ground must not show in single gaps."""
    gaps = np.random.default_rng(seed).random(GRID.shape) < 0.1
    ground, whole, _ = parts(seed, 1.0, ~gaps)
    lower = FuseInput("A", GRID, whole.spc, whole.lidar, ground - 0.75, np.zeros((3, 3)))
    fused = fuse_maplet(lower, DEFAULT_INFORMATION).maplet
    off = np.abs(fused.height - ground)[gaps]
    assert off.max() < 0.1
    assert np.mean(off < 3.0 * fused.sigma[gaps]) > 0.95


def test_a_good_shape_takes_noise_off_dark_returns_and_a_bad_one_adds_none() -> None:
    everywhere = np.ones(GRID.shape, dtype=bool)
    dark = np.broadcast_to(DARK, GRID.shape)
    ground, whole, _ = parts(3, 1.0, everywhere)

    def error(shape_error: float) -> float:
        rng = np.random.default_rng(4)
        prior = ground + shape_error * rng.normal(size=GRID.shape)
        stated = ShapeErrors(2.0 * shape_error, shape_error, np.pi)
        information = SlopeInformation(0.1, 0.1, 0.1, 0.1, 20.0, shape=stated)
        mine = FuseInput("A", GRID, whole.spc, whole.lidar, prior, np.zeros((3, 3)))
        made = fuse_maplet(mine, information, options=FuseOptions(loss="l2")).maplet
        return float(np.sqrt(np.mean((made.height - ground)[dark] ** 2)))

    noise = float(np.sqrt(np.mean((whole.lidar.height - ground)[dark] ** 2)))
    assert error(0.01) < 0.8 * noise
    assert error(0.5) < 1.02 * noise
