"""Images as FITS: every card, every corruption, and what astropy itself reads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from spcola.camera import Camera, SpcImage
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images import read_fits_image, write_fits_image

RNG = np.random.default_rng(3)
AXES = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
AXES *= np.sign(np.linalg.det(AXES))
SUN = np.array([0.48, -0.6, 0.64])


def an_image(**changes: object) -> SpcImage:
    k_matrix = np.array([[117.6471, -0.25, 1e-5], [0.125, 117.6, -2e-5]])
    camera = Camera(
        628.9, np.array([17.5, 12.25]), k_matrix, 34, 24, "owen", [1e-5, -3.3e-7, 2e-6, 1 / 3e5]
    )
    pixels = RNG.integers(0, 2**16, size=(24, 34)).astype(np.uint16)
    image = SpcImage(
        "P01I02", "2019 JUL 01 03:04:05.678", camera, [1e3 / 3, -2345.678, 9.87e2], AXES, SUN,
        (12, 60000), [0.1, 0.2, 0.3], [1e-6, 2e-6, 3e-7], pixels=pixels,
    )  # fmt: skip
    return replace(image, **changes)


def numbers_of(image: SpcImage) -> np.ndarray:
    camera = image.camera
    parts = [image.scobj, image.axes, image.sun, image.scobj_sigma, image.pointing_sigma]
    parts += [camera.center, camera.k_matrix, camera.distortion, [camera.focal_length_mm]]
    return np.concatenate([np.ravel(part) for part in parts])


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_what_is_written_is_read(tmp_path: Path, kind: type) -> None:
    image = an_image(pixels=RNG.integers(0, 256, size=(24, 34)).astype(kind))
    write_fits_image(tmp_path / "a.fits", image, cards={"BITS": (14, "bits")})
    back = read_fits_image(tmp_path / "a.fits")
    assert back.pixels is not None
    assert back.pixels.dtype == kind
    np.testing.assert_array_equal(back.pixels, image.pixels)
    assert (back.name, back.utc, back.thresholds) == (image.name, image.utc, image.thresholds)
    assert back.camera.distortion_model == "owen"
    np.testing.assert_allclose(numbers_of(back), numbers_of(image), rtol=1e-13)


def test_the_header_speaks_for_itself(tmp_path: Path) -> None:
    image = an_image()
    write_fits_image(tmp_path / "a.fits", image)
    with fits.open(tmp_path / "a.fits") as units:
        header = units[0].header
        assert header["NAXIS1"] == 34
        assert header["NAXIS2"] == 24
        assert header["SCOBJ_Y"] == -2345.678
        assert "[m]" in header.comments["SCOBJ_Y"]
        assert header["CZ_X"] == pytest.approx(image.boresight[0], rel=1e-13)
        assert header["UTC"] == image.utc


def test_unknown_sigmas_stay_unknown(tmp_path: Path) -> None:
    image = an_image(scobj_sigma=np.full(3, np.nan), pointing_sigma=np.full(3, np.nan))
    write_fits_image(tmp_path / "a.fits", image)
    back = read_fits_image(tmp_path / "a.fits")
    assert np.isnan(back.scobj_sigma).all()
    assert np.isnan(back.pointing_sigma).all()


def test_every_missing_or_changed_card_is_seen(tmp_path: Path) -> None:
    image = an_image()
    write_fits_image(tmp_path / "a.fits", image)
    with fits.open(tmp_path / "a.fits") as units:
        header, pixels = units[0].header.copy(), units[0].data.copy()
    standard = {"SIMPLE", "BITPIX", "NAXIS", "NAXIS1", "NAXIS2", "EXTEND", "BSCALE", "BZERO"}
    keys = [key for key in header if key not in standard]
    assert len(keys) > 35
    for key in keys:
        for value in (None, "garbled" if not isinstance(header[key], str) else 7):
            changed = header.copy()
            if value is None:
                del changed[key]
            else:
                changed[key] = value
            fits.PrimaryHDU(pixels, changed).writeto(tmp_path / "b.fits", overwrite=True)
            with pytest.raises(FormatError, match=r"b\.fits"):
                read_fits_image(tmp_path / "b.fits")


def test_what_is_no_whole_image_is_refused(tmp_path: Path) -> None:
    write_fits_image(tmp_path / "a.fits", an_image())
    content = (tmp_path / "a.fits").read_bytes()
    for end in (0, 100, 2880, len(content) - 2880):
        (tmp_path / "b.fits").write_bytes(content[:end])
        with pytest.raises(FormatError):
            read_fits_image(tmp_path / "b.fits")
    fits.PrimaryHDU(np.zeros((3, 4))).writeto(tmp_path / "c.fits")
    with pytest.raises(FormatError, match="8 or 16 bits"):
        read_fits_image(tmp_path / "c.fits")


def test_an_impossible_state_is_refused(tmp_path: Path) -> None:
    write_fits_image(tmp_path / "a.fits", an_image())
    for key, value in (("SUN_X", 3.0), ("CX_X", 2.0), ("FOCALMM", -1.0), ("DISTMOD", "none")):
        with fits.open(tmp_path / "a.fits") as units:
            units[0].header[key] = value
            units.writeto(tmp_path / "b.fits", overwrite=True)
        with pytest.raises(FormatError, match=r"b\.fits"):
            read_fits_image(tmp_path / "b.fits")


def test_an_image_without_whole_numbers_is_not_written(tmp_path: Path) -> None:
    for pixels in (None, np.zeros((24, 34))):
        with pytest.raises(InvalidValueError, match="P01I02"):
            write_fits_image(tmp_path / "a.fits", an_image(pixels=pixels))
    assert not list(tmp_path.iterdir())
