"""SPC's names of images."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spcola.errors import InvalidValueError
from spcola.formats.images.names import NamedImage, spc_name, spc_names


@pytest.mark.parametrize(
    ("et", "filter_name", "name"),
    [
        (604997715.91, "PAN", "P604997715PA"),
        (4222564.6, "4", "P00422256404"),
        (4222564.6, "12", "P00422256412"),
        (604997715.0, None, "P604997715"),
        (604997715.0, "b", "P604997715BX"),
        (604997715.0, "BroadBand", "P604997715BR"),
        (-896956456.57, "CLEAR", "P103043543CL"),
        (1_000_000_001.0, "", "P000000001"),
    ],
)
def test_names_follow_the_rule(et, filter_name, name) -> None:
    assert spc_name("P", NamedImage("x.fits", et, filter_name)) == name


@given(st.floats(-2e9, 3e9), st.text(max_size=8))
def test_names_fit_spc(et, filter_name) -> None:
    name = spc_name("M", NamedImage("x", et, filter_name))
    assert 10 <= len(name) <= 12
    assert name.isascii()
    assert name.isalnum()


def test_names_lead_back_to_the_original() -> None:
    images = [NamedImage(f"frame{n}.fits", 6e8 + 30.0 * n, "v") for n in range(4)]
    names = spc_names("N", images)
    assert list(names.values()) == [image.original for image in images]
    assert list(names)[1] == "N600000030VX"


def test_two_images_of_one_name_are_refused_in_one_line() -> None:
    with pytest.raises(InvalidValueError) as caught:
        spc_names("N", [NamedImage("a.fits", 5.1), NamedImage("b.fits", 5.9)])
    assert str(caught.value) == (
        "names of images: a.fits and b.fits both get the name N000000005; "
        "give one of them another camera letter or its own name"
    )


@pytest.mark.parametrize(
    ("camera", "et"), [("", 1.0), ("AB", 1.0), ("é", 1.0), ("A", float("nan"))]
)
def test_impossible_names_are_refused(camera, et) -> None:
    with pytest.raises(InvalidValueError):
        spc_name(camera, NamedImage("a", et))
