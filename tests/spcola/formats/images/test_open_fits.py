"""FITS images, and their detached labels."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.camera import Camera, SpcImage
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images import open_image, write_fits_image

from .opening import LINES, SAMPLES, check, put


@pytest.mark.parametrize("kind", ["u1", ">i2", ">i4", ">f4", ">f8"])
def test_fits_of_every_type(samples, tmp_path, ramp, kind) -> None:
    pixels = (ramp // 16).astype(kind)
    image = open_image(put(tmp_path / "a.fit", samples.fits_bytes(pixels)))
    check(image, pixels, dtype=np.dtype(kind).newbyteorder("="))
    assert image.format == "fits"
    assert image.bits == pixels.dtype.itemsize * 8
    assert image.byte_order == ("" if kind == "u1" else ">")


def test_fits_without_sign_blanks_and_saturation(samples, tmp_path, ramp) -> None:
    stored = (ramp.astype(int) - 32768).astype(">i2")
    cards = [("BZERO", 32768), ("BSCALE", 1), ("BLANK", -32768), ("SATURATE", 4000)]
    pixels = ramp.copy()
    pixels[3, 3:5] = 4000, 4095
    stored[3, 3:5] = 4000 - 32768, 4095 - 32768
    whole = check(open_image(put(tmp_path / "a.fits", samples.fits_bytes(stored, cards))), pixels)
    assert whole.values.dtype == np.uint16
    assert np.argwhere(whole.missing).tolist() == [[0, 0]]
    np.testing.assert_array_equal(whole.saturated, pixels >= 4000)
    assert whole.saturated[3, 3:5].all()


def test_fits_scaled(samples, tmp_path, ramp) -> None:
    cards = [("BSCALE", 0.5), ("BZERO", 10.0), ("BLANK", 0)]
    whole = open_image(
        put(tmp_path / "a.fits", samples.fits_bytes(ramp.astype(">i2"), cards))
    ).read()
    assert np.isnan(whole.values[0, 0])
    assert whole.missing[0, 0]
    np.testing.assert_allclose(whole.values[1:], 0.5 * ramp[1:] + 10.0)


def test_fits_keywords(samples, tmp_path, ramp) -> None:
    cards = [
        ("DATE-OBS", "2019-03-03T08:54:59.913"), ("EXPTIME", 20.0, "[ms] exposure"),
        ("OBJECT", "BENNU"), ("INSTRUME", "MAPCAM"), ("FILTER", "PAN"),
        ("CCDTEMP", -20.0, "[degC] of the detector"),
    ]  # fmt: skip
    label = open_image(
        put(tmp_path / "a.fits", samples.fits_bytes(ramp.astype(">i2"), cards))
    ).label
    assert (label.target, label.instrument, label.filter) == ("BENNU", "MAPCAM", "PAN")
    assert label.exposure_s == pytest.approx(0.02)
    assert label.temperatures_k == {"CCDTEMP": pytest.approx(253.15)}
    mid = label.mid_exposure()
    assert mid is not None
    assert mid.source == "start_and_exposure"


def test_fits_exposure_without_unit(samples, tmp_path, ramp) -> None:
    # New Horizons' LORRI gives milliseconds in EXPOSURE, other missions seconds.
    cards = [("SPCUTCID", "2007-02-28T01:23:45.678"), ("EXPOSURE", 4.0), ("UTC", "not the middle")]
    image = open_image(put(tmp_path / "a.fits", samples.fits_bytes(ramp.astype(">i2"), cards)))
    assert image.label.exposure_s is None
    assert image.notes == ("EXPOSURE has no unit and is not used",)
    mid = image.label.mid_exposure()
    assert mid is not None
    assert mid.source == "stated"


def test_fits_with_one_plane_and_with_an_extension(samples, tmp_path, ramp) -> None:
    plane = ramp.astype(">i2")
    check(open_image(put(tmp_path / "a.fits", samples.fits_bytes(plane[None]))), ramp)
    empty = samples.fits_bytes(np.zeros((0,), "u1"))
    extension = samples.fits_bytes(plane).replace(
        b"SIMPLE  =                    T", b"XTENSION= 'IMAGE   '          ", 1
    )
    check(open_image(put(tmp_path / "b.fits", empty + extension)), ramp)
    path = put(tmp_path / "c.fits", samples.fits_bytes(np.stack([plane, plane + 1]).astype(">i2")))
    check(open_image(path, band=2), ramp + 1)
    with pytest.raises(FormatError, match="has 2 bands; write one of them"):
        open_image(path)


def test_bands_of_pds_images(samples, tmp_path, ramp) -> None:
    planes = np.stack([ramp, ramp + 1, ramp + 2])
    put(tmp_path / "a.img", planes.astype(">u2").tobytes())
    more = " BANDS = 3\r\n BAND_STORAGE_TYPE = BAND_SEQUENTIAL\r\n"
    text = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"', more=more)
    check(open_image(put(tmp_path / "a.lbl", text), band=3), ramp + 2)
    axis = "<Axis_Array><axis_name>Band</axis_name><elements>3</elements>"
    axis += "<sequence_number>0</sequence_number></Axis_Array><Axis_Array><axis_name>Line<"
    text = samples.pds4_text("a.img", planes.nbytes, "UnsignedMSB2").replace("2D_I", "3D_I")
    text = text.replace("<Axis_Array><axis_name>Line<", axis)
    path = put(tmp_path / "b.xml", text)
    check(open_image(path, band=2), ramp + 1)
    with pytest.raises(InvalidValueError, match="has no band 4"):
        open_image(path, band=4)
    with pytest.raises(FormatError, match="has 3 bands; write one of them"):
        open_image(path)


def test_own_fits_is_read_with_its_name_and_time(tmp_path, ramp) -> None:
    camera = Camera(100.0, [15.5, 20.5], [[10, 0, 0], [0, 10, 0]], SAMPLES, LINES)
    state = SpcImage(
        "P0042", "2019 JUL 01 00:00:00.000", camera, [0, 0, 1e3], np.eye(3), [1, 0, 0],
        pixels=ramp,
    )  # fmt: skip
    write_fits_image(tmp_path / "a.fits", state)
    image = open_image(tmp_path / "a.fits")
    check(image, ramp, dtype=np.uint16)
    mid = image.label.mid_exposure()
    assert mid is not None
    assert (image.name, mid.source) == ("P0042", "stated")


def fits_with_labels(samples, folder, ramp):
    content = samples.fits_bytes((ramp.astype(int) - 32768).astype(">i2"), [("BZERO", 32768)])
    put(folder / "a.fit", content)
    scaling = "<value_offset>32768</value_offset>"
    put(
        folder / "a.xml",
        samples.pds4_text("a.fit", len(content), "SignedMSB2", offset=2880, scaling=scaling),
    )
    put(folder / "a.lbl", samples.pds3_text(16, "MSB_INTEGER", '("A.FIT", 2881 <BYTES>)'))


@pytest.mark.parametrize(
    ("opened", "label"), [("a.fit", "a.xml"), ("a.xml", "a.xml"), ("a.lbl", "a.lbl")]
)
def test_a_fits_file_and_its_label_are_one_image(samples, tmp_path, ramp, opened, label) -> None:
    fits_with_labels(samples, tmp_path, ramp)
    image = open_image(tmp_path / opened)
    check(image, ramp, dtype=np.uint16)
    assert image.described == f"30 × 40 pixels of 16 bits from a.fit, label {label} " + (
        "(pds4)" if label == "a.xml" else "(pds3)"
    )
    other = "a.lbl" if label == "a.xml" else "a.xml"
    assert f"{other} is not read: {label} is" in image.notes
    assert image.label.keywords["FITS"]["BITPIX"] == 16


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<elements>40<", "<elements>20<", "has size 30 × 40, its label a.xml gives 30 × 20"),
        ("SignedMSB2", "UnsignedByte", "has pixel type >i2, its label a.xml gives .u1"),
        (">2880<", ">0<", "has first byte of the pixels 2881"),
        (">32768<", ">1<", r"has scaling 1.0 × 32768.0, its label a.xml gives 1.0 × 1.0"),
        ('"byte">5760<', '"byte">5000<', "has 5760 bytes, its label a.xml gives 5000"),
    ],
)
def test_label_and_fits_that_disagree(samples, tmp_path, ramp, old, new, message) -> None:
    fits_with_labels(samples, tmp_path, ramp)
    label = tmp_path / "a.xml"
    assert old in label.read_text()
    label.write_text(label.read_text().replace(old, new, 1))
    with pytest.raises(FormatError, match=message):
        open_image(tmp_path / "a.fit")
