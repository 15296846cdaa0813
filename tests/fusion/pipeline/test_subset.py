"""Subsets of items: by name and by place."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.pipeline.subset import Place, Subset
from spcola.errors import InvalidValueError

CENTERS = {
    "POLE": np.array([0.0, 0.0, 250.0]),
    "EAST": np.array([0.0, 240.0, 0.0]),
    "NEAR": np.array([0.0, 240.0 * np.cos(0.1), 240.0 * np.sin(0.1)]),
}


def test_a_circle_is_measured_along_the_surface() -> None:
    """0.1 radians on a radius of 240 m are 24 m."""
    for radius, names in ((23.9, ["EAST"]), (24.1, ["EAST", "NEAR"]), (400.0, list(CENTERS))):
        chosen = Subset(place=Place(0.0, 90.0, radius)).chosen(CENTERS, CENTERS)
        assert list(chosen) == [name for name in CENTERS if name in names]
    assert Place.parse("0,-270,24.1").holds(CENTERS["NEAR"])
    assert not Place(0.0, -90.0, 700.0).holds(CENTERS["EAST"])


def test_names_and_place_are_both_required() -> None:
    both = Subset(frozenset({"POLE", "EAST"}), Place(90.0, 0.0, 1.0))
    assert list(both.chosen(CENTERS, CENTERS)) == ["POLE"]
    assert list(Subset(frozenset({"EAST"})).chosen(CENTERS)) == ["EAST"]
    assert not Subset()
    assert Subset().chosen(CENTERS) == CENTERS


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "91,0,5", "0,0,0", "0,nan,5", "a,b,c"])
def test_what_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(InvalidValueError, match="LAT,LON,RADIUS_M"):
        Place.parse(text)


def test_unknown_names_and_empty_subsets_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="did you mean EAST"):
        Subset(frozenset({"EAS"})).chosen(CENTERS)
    with pytest.raises(InvalidValueError, match="leave none of 3"):
        Subset(place=Place(-90.0, 0.0, 1.0)).chosen(CENTERS, CENTERS)
