"""Names of products: the examples of the archive, the corners of the sphere, no two alike."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.products import product_stems
from fusion.products.naming import product_stem
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid


def grid_at(longitude_deg: float, latitude_deg: float, gsd: float = 0.05) -> MapletGrid:
    lon, lat = np.radians([longitude_deg, latitude_deg])
    place = 250.0 * np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    return MapletGrid.facing(place, place, gsd, 3)


@pytest.mark.parametrize(
    ("longitude", "latitude", "place"),
    [
        (42.17, 55.95, "5595n04217"),
        (359.999, -0.001, "0000n00000"),
        (0.0, 0.0, "0000n00000"),
        (271.5, -89.996, "9000s27150"),
        (180.0, -7.126, "0713s18000"),
    ],
)
def test_place_in_a_name(longitude: float, latitude: float, place: str) -> None:
    stem = product_stem(grid_at(longitude, latitude), version=21, source="OLA")
    assert stem == f"l_00050mm_alt_dtm_{place}_v021"


def test_no_two_products_share_a_name() -> None:
    grids = [grid_at(10, 20), grid_at(10.001, 20.001), grid_at(10, 20, 0.06), grid_at(10, 20)]
    products = [stem.split("_")[3] for stem in product_stems(grids, version=1)]
    assert products == ["dtm", "dtm2", "dtm", "dtm3"]


@pytest.mark.parametrize("wrong", [{"source": "XXX"}, {"version": 1000}, {"product": "D T M"}])
def test_refuses_what_no_name_can_hold(wrong: dict) -> None:
    with pytest.raises(InvalidValueError):
        product_stem(grid_at(1, 1), **{"version": 1, **wrong})
