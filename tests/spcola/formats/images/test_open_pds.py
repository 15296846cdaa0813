"""PDS3 and PDS4 images."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import rasterio

from spcola.camera.detector import Orientation
from spcola.formats.images import open_image

from .opening import LINES, SAMPLES, check, put

TYPES = [
    (8, "UNSIGNED_INTEGER", "u1"), (16, "MSB_UNSIGNED_INTEGER", ">u2"),
    (16, "LSB_UNSIGNED_INTEGER", "<u2"), (16, "PC_INTEGER", "<i2"), (16, "SUN_INTEGER", ">i2"),
    (32, "MSB_INTEGER", ">i4"), (32, "IEEE_REAL", ">f4"), (32, "PC_REAL", "<f4"),
    (64, "IEEE_REAL", ">f8"),
]  # fmt: skip


@pytest.mark.parametrize(("bits", "kind", "dtype"), TYPES)
def test_pds3_attached_and_detached(samples, tmp_path, ramp, bits, kind, dtype) -> None:
    pixels = (ramp // (16 if bits == 8 else 1)).astype(dtype)
    record = SAMPLES * bits // 8
    records = -(-1500 // record)
    head = samples.pds3_text(bits, kind, records + 1, record=record).encode()
    attached = put(tmp_path / "a.img", head.ljust(records * record) + pixels.tobytes())
    image = open_image(attached)
    check(image, pixels, dtype=np.dtype(dtype).newbyteorder("="))
    assert (image.format, image.pixel_path) == ("pds3", attached)
    put(tmp_path / "B.IMG", b"skip" + pixels.tobytes())
    label = put(tmp_path / "b.lbl", samples.pds3_text(bits, kind, '("b.img", 5 <BYTES>)'))
    for opened in (label, tmp_path / "B.IMG"):
        image = open_image(opened)
        check(image, pixels)
        assert (image.label_path, image.pixel_path.name) == (label, "B.IMG")
        assert image.byte_order == ("" if bits == 8 else dtype[0])


def test_pds3_agrees_with_gdal(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    path = put(tmp_path / "a.lbl", samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"'))
    with warnings.catch_warnings(action="ignore"), rasterio.open(path) as dataset:
        np.testing.assert_array_equal(open_image(path).read().values, dataset.read(1))


def test_pds3_label(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    path = put(tmp_path / "a.lbl", samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"'))
    label = open_image(path).label
    assert (label.name, label.target, label.instrument) == ("FC2_00042", "4 VESTA", "FC2")
    assert (label.filter, label.clock_start) == ("1", "364712345:066")
    assert label.exposure_s == pytest.approx(0.02)
    assert label.temperatures_k == {"DETECTOR_TEMPERATURE": 220.5}
    assert label.orientation == Orientation("up", "right")  # type: ignore[arg-type]
    # The first row of the file is line 1, whatever the display direction.
    np.testing.assert_array_equal(open_image(path).read().values[0], ramp[0])


def test_pds3_lines_with_more_than_pixels_scaling_and_special_values(
    samples, tmp_path, ramp
) -> None:
    rows = np.zeros((LINES, 6 + 2 * SAMPLES + 4), np.uint8)
    rows[:, 6:-4] = ramp.astype(">u2").view(np.uint8).reshape(LINES, -1)
    put(tmp_path / "a.img", rows.tobytes())
    more = (
        " LINE_PREFIX_BYTES = 6\r\n LINE_SUFFIX_BYTES = 4\r\n SCALING_FACTOR = 0.25\r\n"
        " OFFSET = 3.0\r\n MISSING_CONSTANT = 0\r\n PIXEL_SATURATION_VALUE = 4000\r\n"
    )
    text = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"', more=more)
    whole = open_image(put(tmp_path / "a.lbl", text)).read()
    assert np.argwhere(whole.missing).tolist() == [[0, 0]]
    np.testing.assert_array_equal(whole.saturated, ramp >= 4000)
    np.testing.assert_allclose(whole.values[whole.valid], 0.25 * ramp[whole.valid] + 3.0)
    assert np.isnan(whole.values[~whole.valid]).all()


@pytest.mark.parametrize(
    ("exposure", "value", "note"),
    [
        ("20.0", 0.02, "no unit: read as milliseconds"),
        ("0.0200", 0.02, "no unit: read as seconds"),
        ("35.0", None, "no unit, and does not fit start and stop: not used"),
        ("35.0 <ms>", 0.035, "start and stop are 0.02 s apart, the exposure time is 0.035 s"),
    ],
)
def test_pds3_doubtful_exposures(samples, tmp_path, ramp, exposure, value, note) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    text = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"', exposure=exposure)
    image = open_image(put(tmp_path / "a.lbl", text))
    assert image.label.exposure_s == (None if value is None else pytest.approx(value))
    assert len(image.notes) == 1
    assert note in image.notes[0]


@pytest.mark.parametrize(
    ("kind", "dtype"),
    [("UnsignedByte", "u1"), ("UnsignedMSB2", ">u2"), ("SignedLSB2", "<i2"),
     ("UnsignedLSB4", "<u4"), ("IEEE754LSBSingle", "<f4"), ("IEEE754MSBDouble", ">f8")],
)  # fmt: skip
def test_pds4_rows_are_those_of_the_file(samples, tmp_path, ramp, kind, dtype) -> None:
    pixels = (ramp // (16 if dtype == "u1" else 1)).astype(dtype)
    content = b"head" + pixels.tobytes()
    put(tmp_path / "a.dat", content)
    path = put(tmp_path / "a.xml", samples.pds4_text("a.dat", len(content), kind, offset=4))
    image = open_image(path)
    check(image, pixels)
    # GDAL shows the image as the label wishes, the last line first.
    with warnings.catch_warnings(action="ignore"), rasterio.open(path) as dataset:
        assert image.label.orientation is not None
        shown = image.label.orientation.apply(image.read().values)
        np.testing.assert_array_equal(shown, dataset.read(1))


def test_pds4_label(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.dat", ramp.astype("<u2").tobytes())
    scaling = "<scaling_factor>2.0</scaling_factor><value_offset>1.0</value_offset>"
    constants = (
        "<Special_Constants><missing_constant>0</missing_constant>"
        "<saturated_constant>90</saturated_constant></Special_Constants>"
    )
    path = put(
        tmp_path / "a.xml",
        samples.pds4_text("a.dat", 2400, "UnsignedLSB2", scaling=scaling, constants=constants),
    )
    image = open_image(path)
    label = image.label
    assert (label.name, label.target, label.instrument) == ("image_0042", "Bennu", "MapCam")
    assert (label.filter, label.exposure_s) == ("PAN", pytest.approx(0.05))
    assert label.temperatures_k == {"CCD": pytest.approx(253.15)}
    assert label.orientation == Orientation("up", "right")  # type: ignore[arg-type]
    whole = image.read()
    assert (np.count_nonzero(whole.missing), np.count_nonzero(whole.saturated)) == (1, 1)
    np.testing.assert_array_equal(whole.values[2:], 2.0 * ramp[2:] + 1.0)
