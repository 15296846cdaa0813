"""The figures' numbers: light from the right side, north where it is, bins, residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.fusing.maplets import Source
from fusion.report.data import Origins
from fusion.report.figures.maps import _local
from fusion.report.figures.origins import origins_figure
from fusion.report.figures.scale import binned
from fusion.report.figures.surfaces import surfaces_figure
from fusion.report.gather import choose_places
from fusion.report.layout import number_text
from fusion.report.maplets import hillshade
from fusion.report.maplets.panels import north_on_image
from spcola.grids import MapletGrid
from spcola.math import lattice, lon_lat_deg


def test_slopes_that_face_the_light_are_bright() -> None:
    n, m = np.meshgrid(np.arange(-5.0, 6.0), np.arange(-5.0, 6.0))
    flat = hillshade(np.zeros((11, 11)), 1.0)
    np.testing.assert_allclose(flat, np.sqrt(0.5))
    # Light comes from −Ux, −Uy: ground that rises along both faces it.
    np.testing.assert_allclose(hillshade((n + m) / np.sqrt(2.0), 1.0), 1.0)
    np.testing.assert_allclose(hillshade(-(n + m) / np.sqrt(2.0), 1.0), 0.0, atol=1e-12)
    # The grid spacing is what makes a slope of a step.
    assert hillshade(n, 10.0).mean() < hillshade(n, 1.0).mean()


def test_a_single_row_of_returns_has_a_shade() -> None:
    height = np.full((9, 9), np.nan)
    height[:, 4] = 0.3
    shade = hillshade(height, 1.0)
    assert np.isfinite(shade).sum() == 9
    np.testing.assert_allclose(shade[4], np.sqrt(0.5))


@pytest.mark.parametrize("latitude", [-70.0, 0.0, 55.0])
def test_north_is_up_in_the_usual_orientation(latitude) -> None:
    normal = [np.cos(np.radians(latitude)), 0.0, np.sin(np.radians(latitude))]
    grid = MapletGrid.facing(np.multiply(normal, 250.0), normal, 1.0, 5)
    np.testing.assert_allclose(north_on_image(grid), [0.0, 1.0], atol=1e-12)


def test_north_follows_the_axes_and_ends_at_the_pole() -> None:
    # Uy north, Ux east: north is to the right in the image.
    turned = MapletGrid([250.0, 0, 0], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], 1.0, 5)
    np.testing.assert_allclose(north_on_image(turned), [1.0, 0.0], atol=1e-12)
    assert north_on_image(MapletGrid.facing([0, 0, 250.0], [0, 0, 1.0], 1.0, 5)) is None


def test_residuals_east_north_up() -> None:
    longitude, latitude = np.array([0.0, 90.0, 0.0]), np.array([0.0, 0.0, 90.0])
    vectors = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]])
    east, north, up = _local(longitude, latitude, vectors)
    np.testing.assert_allclose(east, [2, -1, 2], atol=1e-12)
    np.testing.assert_allclose(north, [3, 3, -1], atol=1e-12)
    np.testing.assert_allclose(up, [1, 2, 3], atol=1e-12)


def test_bins() -> None:
    centers, means, errors = binned(
        np.array([1.0, 2.0, 11.0]), np.array([1.0, 3.0, 7.0]), np.array([0.0, 10.0, 20.0, 30.0])
    )
    np.testing.assert_array_equal(centers, [5.0, 15.0])
    np.testing.assert_array_equal(means, [2.0, 7.0])
    np.testing.assert_allclose(errors, [1.0, np.nan])


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (1.23456, 0.012, "1.235"),
        (-0.5, 0.2, "−0.50"),
        (1236.5, 150.0, "1236"),
        (0.25, None, "0.25"),
        (None, 1.0, "–"),
        (float("nan"), None, "–"),
        (7, None, "7"),
        ("<b>", None, "&lt;b&gt;"),
    ],
)
def test_numbers_have_the_digits_of_their_sigma(value, sigma, text) -> None:
    assert number_text(value, sigma) == text


def test_places_are_chosen_for_their_reasons(places) -> None:
    chosen = choose_places(list(places))
    assert len({place.fused.name for place in chosen}) == len(chosen)
    assert choose_places([]) == []
    # A gap of the lidar is shown where it holds one half and images alone the other.
    whole, gap = (np.where(np.arange(99) < n, 1.0, np.nan) * np.ones((99, 99)) for n in (99, 50))
    one, other = places
    first = choose_places(
        [replace(one, spc=whole, lidar=whole), replace(other, spc=whole, lidar=gap)]
    )
    assert [place.fused.name for place in first] == [other.fused.name, one.fused.name]
    assert "gap of the lidar" in first[0].why


@pytest.fixture(scope="module")
def hemispheres() -> Origins:
    """Images alone north of 20° south, lidar alone south of it, nothing east of 270° there."""
    points = lattice(20_000)
    longitude, latitude = lon_lat_deg(points)
    there = (latitude > -20.0) | (longitude < 270.0)
    source = np.where(latitude > -20.0, Source.IMAGE, Source.LIDAR)
    return Origins(75.0 * points[there], source[there])


def test_the_map_shows_what_heights_rest_on_where_it_is(hemispheres) -> None:
    panel, *poles = origins_figure(hemispheres).axes
    image = np.ma.filled(panel.images[0].get_array(), -1)
    rows, columns = image.shape
    assert (image[int(rows * 72 / 180) :] == Source.IMAGE).all()
    assert (image[: int(rows * 68 / 180), : int(columns * 269 / 360)] == Source.LIDAR).all()
    # Maplets that are missing leave the map white, but for what their neighbours reach.
    west, east = int(columns * 285 / 360), int(columns * 345 / 360)
    assert (image[int(rows * 30 / 180) : int(rows * 60 / 180), west:east] == -1).all()
    north, south = (np.ma.filled(pole.images[0].get_array(), -1) for pole in poles)
    assert (north[rows // 3 : -rows // 3, rows // 3 : -rows // 3] == Source.IMAGE).all()
    # From below, 90° is up, 0° to the left: what lacks, from 270° to 360°, is at the lower left.
    quarter = slice(int(0.30 * rows), int(0.45 * rows)), slice(int(0.55 * rows), int(0.70 * rows))
    assert (south[quarter[0], quarter[0]] == -1).all()
    for i, j in ((0, 1), (1, 0), (1, 1)):
        assert (south[quarter[i], quarter[j]] == Source.LIDAR).all()


def test_images_keep_their_aspect(places) -> None:
    panels = surfaces_figure(places[0]).axes
    assert all(panel.get_aspect() == 1.0 for panel in panels if panel.images)
