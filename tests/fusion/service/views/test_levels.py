"""Overview levels, values and profiles: planted surfaces are read back as they are."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from fusion.service.views.surfaces import LayerCache, Surface, png_of, profile, value_at
from fusion.service.views.surfaces.levels import Rule, levels_of, nearest, overviews, sums_of
from fusion.service.views.surfaces.sources import ArraySource
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid

GSD, HALF = 0.5, 400


def surface_of(half: int = HALF, **layers: np.ndarray) -> Surface:
    grid = MapletGrid.facing([100.0, 200.0, 60.0], [1.0, 2.0, 0.7], GSD, half)
    return Surface("maplet", "MADE", ArraySource(grid, layers, ()), LayerCache())


def plane(half: int = HALF) -> np.ndarray:
    """0.3 m per metre to the right (Uy, rows), −0.1 per metre up (−Ux, columns), 5 m high."""
    steps = GSD * np.arange(-half, half + 1)
    return 5.0 + 0.3 * steps[:, None] - 0.1 * -steps[None, :]


def test_a_ramp_is_read_back_at_every_level() -> None:
    surface = surface_of(height=plane())
    assert surface.levels == (1, 2, 4)
    for level in surface.levels:
        cells = -(-surface.grid.size // level)
        window = surface.window("height", level=level, rows=(0, cells), columns=(0, cells))
        # The last cells have fewer grid points: a mean lies at their own middle.
        first = np.arange(cells) * level
        middle = ((first + np.minimum(first + level - 1, 2 * HALF)) / 2 - HALF) * GSD
        wanted = 5.0 + 0.3 * middle[None, :] - 0.1 * -middle[:, None]
        np.testing.assert_allclose(window, wanted, atol=2e-5)
        slope = surface.window("slope", level=level, rows=(0, cells), columns=(0, cells))
        np.testing.assert_allclose(slope, np.degrees(np.arctan(np.hypot(0.3, 0.1))), atol=1e-3)
        shade = surface.window("hillshade", level=level, rows=(3, 9), columns=(5, 8))
        np.testing.assert_allclose(shade, shade[0, 0], atol=1e-5)


def test_a_profile_of_a_plane_is_a_line_and_its_values_are_those_of_points() -> None:
    sigma = np.full((2 * HALF + 1,) * 2, 0.04)
    surface = surface_of(height=plane(), sigma=sigma)
    found = profile(surface, (-90.0, -73.0), (111.0, 60.0))
    line = 5.0 + 0.3 * found.x - 0.1 * found.y
    np.testing.assert_allclose(found.layers["height"], line, atol=1e-9)
    np.testing.assert_allclose(found.layers["sigma"], 0.04)
    assert found.distance[-1] == pytest.approx(np.hypot(201.0, 133.0))
    at = value_at(surface, float(found.x[7]), float(found.y[7]))
    assert at["layers"]["height"] == pytest.approx(found.layers["height"][7])
    assert at["longitude_deg"] == pytest.approx(found.longitude_deg[7])
    # The centre itself: 5 m above V.
    middle = value_at(surface, 0.0, 0.0)
    grid = surface.grid
    assert middle["radius_m"] == pytest.approx(np.linalg.norm(grid.center + 5.0 * grid.uz))
    with pytest.raises(InvalidValueError, match="is not on the grid, within ± 200 m"):
        value_at(surface, 0.0, 201.0)
    # The largest numbers too, though they overflow in grid steps.
    with pytest.raises(InvalidValueError, match="is not on the grid"):
        value_at(surface, 0.0, 1.7e308)


def test_nothing_unknown_becomes_a_number() -> None:
    rng = np.random.default_rng(5)
    height = plane()
    height[rng.random(height.shape) < 0.7] = np.nan
    surface = surface_of(height=height, sigma=np.full(height.shape, 0.1))
    image = height.T
    cells = surface.grid.size // 4
    blocks = image[: 4 * cells, : 4 * cells].reshape(cells, 4, cells, 4).swapaxes(1, 2)
    blocks = blocks.reshape(cells, cells, 16)
    known = np.isfinite(blocks).any(axis=2)
    assert not known.all()
    for layer in ("height", "sigma"):
        window = surface.window(layer, level=4, rows=(0, cells), columns=(0, cells))
        np.testing.assert_array_equal(np.isfinite(window), known)
    window = surface.window("height", level=4, rows=(0, cells), columns=(0, cells))
    np.testing.assert_allclose(window[known], np.nanmean(blocks[known], axis=1), rtol=1e-6)
    for layer in ("height", "hillshade", "slope", "sigma"):
        first = surface.window(layer, rows=(0, 60), columns=(0, 60))
        assert not np.isfinite(first[~np.isfinite(image[:60, :60])]).any()
    # Between grid points all four count; on a grid point only itself.
    row, column = np.argwhere(np.isfinite(image) & ~np.isfinite(np.roll(image, -1, 1)))[10]
    x, y = (column - HALF) * GSD, (HALF - row) * GSD
    assert value_at(surface, x, y)["layers"]["height"] == pytest.approx(image[row, column])
    assert np.isnan(value_at(surface, x + 0.1, y)["layers"]["height"])
    assert np.isnan(surface.tile("height", 1, 3, 3)[801 - 768 :]).all()


def test_the_sigma_of_a_mean_is_bounded_whatever_the_correlation() -> None:
    def reduced(sigma: np.ndarray, height: np.ndarray) -> float:
        return overviews([sums_of(sigma, np.isfinite(height))], [2], Rule.SIGMA)[2][0, 0]

    rng = np.random.default_rng(6)
    sigma = rng.uniform(0.1, 1.0, (2, 2))
    level = reduced(sigma, np.zeros((2, 2)))
    assert level == pytest.approx(sigma.mean())
    for _ in range(20):
        mixed = rng.normal(size=(4, 4))
        covariance = mixed @ mixed.T
        spread = np.sqrt(np.diag(covariance))
        covariance *= np.outer(sigma.ravel() / spread, sigma.ravel() / spread)
        assert np.sqrt(covariance.sum()) / 4 <= level + 1e-6
    common = np.outer(sigma.ravel(), sigma.ravel())
    assert np.sqrt(common.sum()) / 4 == pytest.approx(level)
    # The sigma of an unknown height does not count; an unknown one of a height makes all unknown.
    holed = np.array([[0.0, np.nan], [0.0, 0.0]])
    assert reduced(sigma, holed) == pytest.approx((sigma.sum() - sigma[0, 1]) / 3)
    assert np.isnan(reduced(holed, np.zeros((2, 2))))


def test_counts_add_up_and_sources_are_those_of_a_point() -> None:
    rng = np.random.default_rng(7)
    size = 601
    count, source = rng.integers(0, 9, (size, size)), rng.integers(0, 5, (size, size))
    surface = surface_of(300, height=np.zeros((size, size)), count=count, source=source)
    for level in levels_of(size):
        cells = -(-size // level)
        whole = {"level": level, "rows": (0, cells), "columns": (0, cells)}
        assert surface.window("count", **whole).sum() == count.sum()
        found = surface.window("source", **whole)
        assert found[5, 7] == source.T[5 * level + level // 2, 7 * level + level // 2]
    np.testing.assert_array_equal(nearest(source, 4)[-1, 0], source[600, 2])


def test_pictures_have_the_stated_values_and_gaps() -> None:
    values = np.array([[0.0, 0.5, 1.0], [np.nan, -9.0, 9.0]])
    grey = np.asarray(Image.open(io.BytesIO(png_of(values, "height", (0.0, 1.0), bits=16))))
    assert grey.tolist()[0] == [1, 32768, 65535]
    assert grey.tolist()[1] == [0, 1, 65535]
    shown = Image.open(io.BytesIO(png_of(values, "height", (0.0, 1.0)))).convert("RGBA")
    pixels = np.asarray(shown)
    np.testing.assert_array_equal(pixels[..., 3], [[255] * 3, [0, 255, 255]])
    # Viridis, from its first to its last colour.
    np.testing.assert_array_equal(pixels[0, [0, 2], :3], [[68, 1, 84], [253, 231, 37]])
    sources = np.asarray(
        Image.open(io.BytesIO(png_of(np.arange(5.0)[None], "source", (0, 4)))).convert("RGBA")
    )
    assert sources[0, :, 3].tolist() == [0, 255, 255, 255, 255]
    assert sources[0, 1, :3].tolist() == [0x00, 0x72, 0xB2]
    with pytest.raises(InvalidValueError, match="do not ascend"):
        png_of(values, "height", (1.0, 1.0))
