"""ISIS cubes, TIFF, PNG and .DAT."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images import open_image, write_image_data

from .opening import LINES, SAMPLES, check, put, write_raster

ISIS_TYPES = [
    ("UnsignedByte", "u1", 0, None, 255),
    ("SignedWord", "i2", -32768, -32766, -32765),
    ("UnsignedWord", "u2", 0, 2, 65535),
]


@pytest.mark.parametrize("tile", [None, (16, 13)])
@pytest.mark.parametrize("order", ["Lsb", "Msb"])
@pytest.mark.parametrize(("kind", "dtype", "null", "low", "high"), ISIS_TYPES)
def test_isis_integers(samples, tmp_path, ramp, tile, order, kind, dtype, null, low, high) -> None:
    pixels = (ramp // 20 + 3).astype(dtype)
    pixels[1, 1], pixels[2, 2] = null, high
    pixels[3, 3] = 7 if low is None else low
    path = put(tmp_path / "a.cub", samples.isis_bytes(pixels, kind, order=order, tile=tile))
    whole = check(open_image(path), pixels)
    assert np.argwhere(whole.missing).tolist() == [[1, 1]]
    assert np.argwhere(whole.saturated).tolist() == [[2, 2]]
    assert np.argwhere(whole.dark).tolist() == ([] if low is None else [[3, 3]])


def test_isis_reals(samples, tmp_path, ramp) -> None:
    pixels = (ramp * 0.01).astype("f4")
    for place in range(5):  # Null, LRS, LIS, HIS, HRS
        pixels.view("u4")[place, place] = 0xFF7FFFFB + place
    whole = open_image(put(tmp_path / "a.cub", samples.isis_bytes(pixels, "Real"))).read()
    assert np.argwhere(whole.missing).tolist() == [[0, 0]]
    assert np.argwhere(whole.dark).tolist() == [[1, 1], [2, 2]]
    assert np.argwhere(whole.saturated).tolist() == [[3, 3], [4, 4]]
    np.testing.assert_array_equal(whole.values[whole.valid], pixels[whole.valid])
    assert np.isnan(whole.values[~whole.valid]).all()


def test_isis_base_and_multiplier(samples, tmp_path, ramp) -> None:
    content = samples.isis_bytes(ramp.astype("i2"), "SignedWord", base=32768.0, multiplier=0.5)
    image = open_image(put(tmp_path / "a.cub", content))
    np.testing.assert_array_equal(image.read().values, 32768 + 0.5 * ramp)
    assert image.label.exposure_s == pytest.approx(4.2976e-3)
    assert image.label.temperatures_k == {"CameraTemperature": pytest.approx(244.65)}


def test_isis_bands_are_chosen(samples, tmp_path, ramp) -> None:
    content = samples.isis_bytes(np.stack([ramp, ramp + 1]), "UnsignedWord")
    path = put(tmp_path / "a.cub", content)
    check(open_image(path, band=2), ramp + 1)
    with pytest.raises(FormatError, match="has 2 bands; write one of them"):
        open_image(path)
    with pytest.raises(InvalidValueError, match="has no band 3"):
        open_image(path, band=3)


def test_isis_exposure_without_unit_is_not_used(samples, tmp_path, ramp) -> None:
    image = open_image(
        put(tmp_path / "a.cub", samples.isis_bytes(ramp, "UnsignedWord", exposure="4.3"))
    )
    assert image.label.exposure_s is None
    assert image.notes == ("ExposureDuration has no unit and is not used",)


@pytest.mark.parametrize(
    ("driver", "dtype"),
    [("GTiff", "u1"), ("GTiff", "u2"), ("GTiff", "i2"), ("GTiff", "u4"), ("GTiff", "f4"),
     ("PNG", "u1"), ("PNG", "u2")],
)  # fmt: skip
def test_rasters_of_8_to_32_bits(tmp_path, ramp, driver, dtype) -> None:
    pixels = (ramp // (16 if dtype == "u1" else 1)).astype(dtype)
    image = open_image(write_raster(tmp_path / "a.x", driver, [pixels]))
    check(image, pixels, dtype=dtype)
    assert image.format == ("tiff" if driver == "GTiff" else "png")
    assert image.label_path is None


def test_missing_pixels_of_rasters(tmp_path, ramp) -> None:
    path = write_raster(tmp_path / "a.tif", "GTiff", [ramp], nodata=0)
    assert np.argwhere(open_image(path).read().missing).tolist() == [[0, 0]]
    alpha = np.full(ramp.shape, 255, np.uint8)
    alpha[4, 5] = 0
    grey = (ramp // 16).astype(np.uint8)
    path = write_raster(tmp_path / "a.png", "PNG", [grey, grey, grey, alpha])
    whole = check(open_image(path), grey)
    assert np.argwhere(whole.missing).tolist() == [[4, 5]]


def test_colour_is_refused_unless_a_band_is_given(tmp_path, ramp) -> None:
    grey = (ramp // 16).astype(np.uint8)
    path = write_raster(tmp_path / "a.png", "PNG", [grey, grey + 1, grey])
    with pytest.raises(FormatError, match="is in colour; convert it to grey"):
        open_image(path).read()
    check(open_image(path, band=2), grey + 1)


@pytest.mark.parametrize("order", ["<", ">"])
def test_dat_needs_its_size(tmp_path, ramp, order) -> None:
    write_image_data(tmp_path / "A.DAT", ramp, byte_order=order)
    check(open_image(tmp_path / "A.DAT", size=(SAMPLES, LINES)), ramp)
    with pytest.raises(FormatError, match=r"a \.DAT file needs its size"):
        open_image(tmp_path / "A.DAT")
    with pytest.raises(FormatError, match="has 2400 bytes"):
        open_image(tmp_path / "A.DAT", size=(SAMPLES, LINES - 1))
