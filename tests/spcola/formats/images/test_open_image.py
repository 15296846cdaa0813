"""Pixels and labels of every format, and the contradictions that are refused."""

from __future__ import annotations

import tracemalloc
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import rasterio

from spcola.camera import Camera, SpcImage
from spcola.camera.detector import Orientation
from spcola.errors import FormatError, InvalidValueError, SpcolaError
from spcola.formats.images import open_image, write_fits_image, write_image_data

LINES, SAMPLES = 40, 30


def put(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def check(image, expected, *, dtype=None):
    """Compare size, all pixels and a window."""
    assert (image.height, image.width) == expected.shape
    whole = image.read()
    np.testing.assert_array_equal(whole.values, expected)
    assert dtype is None or whole.values.dtype == dtype
    part = image.read(lines=slice(3, 9), samples=slice(5, None))
    np.testing.assert_array_equal(part.values, expected[3:9, 5:])
    return whole


# FITS


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
    with pytest.raises(FormatError, match="has 2 bands; give the number of one"):
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
    with pytest.raises(FormatError, match="has 3 bands; give the number of one"):
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


# PDS3

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


# PDS4


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


# Detached labels of FITS files


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


# ISIS

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
    with pytest.raises(FormatError, match="has 2 bands; give the number of one"):
        open_image(path)
    with pytest.raises(InvalidValueError, match="has no band 3"):
        open_image(path, band=3)


def test_isis_exposure_without_unit_is_not_used(samples, tmp_path, ramp) -> None:
    image = open_image(
        put(tmp_path / "a.cub", samples.isis_bytes(ramp, "UnsignedWord", exposure="4.3"))
    )
    assert image.label.exposure_s is None
    assert image.notes == ("ExposureDuration has no unit and is not used",)


# TIFF, PNG, .DAT


def write_raster(path, driver, bands, **options):
    bands = np.asarray(bands)
    with warnings.catch_warnings(action="ignore"), rasterio.open(
        path, "w", driver=driver, count=len(bands), height=LINES, width=SAMPLES,
        dtype=bands.dtype, **options,
    ) as dataset:  # fmt: skip
        dataset.write(bands)
    return path


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
    with pytest.raises(FormatError, match="is in colour; give the number of one band"):
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


# What is wrong


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.fit", lambda s, p: s.fits_bytes(p.astype(">i2"))[:-1000]),
        ("a.cub", lambda s, p: s.isis_bytes(p, "UnsignedWord")[:-2]),
        ("a.cub", lambda s, p: s.isis_bytes(p, "UnsignedWord", tile=(16, 16))[:-2]),
        ("a.img", lambda s, p: s.pds3_text(16, "MSB_INTEGER", 101, record=20).encode().ljust(2000)
         + p.tobytes()[:-2]),
    ],
)  # fmt: skip
def test_truncated_files_are_refused_at_opening(samples, tmp_path, ramp, name, content) -> None:
    with pytest.raises(FormatError, match="truncated"):
        open_image(put(tmp_path / name, content(samples, ramp)))


@pytest.mark.parametrize("dtype", ["u2", "i4", "f4", "f8"])
@pytest.mark.parametrize("stated", [">", "<"])
def test_the_wrong_byte_order_is_refused(samples, tmp_path, ramp, dtype, stated) -> None:
    names = {"u2": "UNSIGNED_INTEGER", "i4": "INTEGER", "f4": "REAL", "f8": "REAL"}
    order = ("IEEE" if "f" in dtype else "MSB") if stated == ">" else "PC"
    noise = np.random.default_rng(2).normal(0, 20, ramp.shape)
    pixels = np.clip(ramp + noise, 0, None).astype(stated + dtype)
    label = samples.pds3_text(pixels.dtype.itemsize * 8, f"{order}_{names[dtype]}", '"a.img"')
    path = put(tmp_path / "a.lbl", label)
    put(tmp_path / "a.img", pixels.tobytes())
    check(open_image(path), pixels)
    put(tmp_path / "a.img", pixels.byteswap().tobytes())
    with pytest.raises(FormatError, match="contradict the byte order in its label"):
        open_image(path).read()


def test_eight_bits_moved_up_are_no_contradiction(samples, tmp_path, ramp) -> None:
    pixels = (ramp // 16 * 256).astype(">u2")
    put(tmp_path / "a.img", pixels.tobytes())
    label = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"')
    check(open_image(put(tmp_path / "a.lbl", label)), pixels)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"pointer": '"other.img"'},
            "names other.img, which is not in the same folder|cannot be read",
        ),
        ({"pointer": '"../a.img"'}, "names|cannot be read"),
        ({"kind": "VAX_REAL", "bits": 32}, "which are not read|cannot be read"),
        ({"more": " BANDS = 3\r\n"}, "has 3 bands stored as None, one is needed|cannot be read"),
        ({"more": ' ENCODING_TYPE = "HUFFMAN"\r\n'}, "is compressed|cannot be read"),
        ({"lines": 400}, "has 2400 bytes, its label needs 24000"),
    ],
)
def test_pds3_labels_that_cannot_be_used(samples, tmp_path, ramp, change, message) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    entries = {"bits": 16, "kind": "MSB_UNSIGNED_INTEGER", "pointer": '"a.img"'} | change
    with pytest.raises(FormatError, match=message):
        open_image(put(tmp_path / "a.lbl", samples.pds3_text(**entries)))


@pytest.mark.parametrize("cards", [[("BSCALE", 0.0)], [("BZERO", "1E300")]])
def test_impossible_scalings_are_refused(samples, tmp_path, ramp, cards) -> None:
    content = samples.fits_bytes(ramp.astype(">i2"), cards).replace(b"'1E300   '", b"1E300     ")
    with pytest.raises(FormatError, match="has an impossible scaling"):
        open_image(put(tmp_path / "a.fits", content))


def test_an_end_before_the_start_is_refused(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    text = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"').replace(
        "24T05:00:00.020", "23T05:00"
    )
    label = open_image(put(tmp_path / "a.lbl", text)).label
    with pytest.raises(FormatError, match="before it starts"):
        label.mid_exposure()


def test_labels_of_tables_are_refused(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.tobytes())
    texts = {
        "a.lbl": samples.pds3_text(16, "MSB_INTEGER", '"a.img"').replace("IMAGE", "TABLE"),
        "b.xml": samples.pds4_text("a.img", 2400, "UnsignedLSB2").replace(
            "Array_2D_I", "Array_2D_T"
        ),
    }
    for name, text in texts.items():
        with pytest.raises(FormatError, match="without an image; name the data file"):
            open_image(put(tmp_path / name, text))


def test_an_unknown_encoding_is_refused(samples, tmp_path, ramp) -> None:
    text = samples.pds4_text("a.dat", 2400, "UnsignedLSB2").replace("UTF-8", "UTF-9")
    with pytest.raises(FormatError, match="cannot be read as XML"):
        open_image(put(tmp_path / "a.xml", text))


def test_contradicting_display_directions_give_none(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.dat", ramp.astype("<u2").tobytes())
    text = samples.pds4_text("a.dat", 2400, "UnsignedLSB2")
    part = text[text.index("<disp:Display_Settings>") : text.index("<img:Imaging>")]
    other = part.replace("Left to Right", "Right to Left")
    image = open_image(put(tmp_path / "a.xml", text.replace(part, part + other)))
    assert image.label.orientation is None
    assert image.notes[0].startswith("the label's display directions contradict each other")


@pytest.mark.parametrize("window", [slice(0, 41), slice(5, 5), slice(-3, None), slice(0, 9, 2)])
def test_windows_beyond_the_image_are_refused(samples, tmp_path, ramp, window) -> None:
    image = open_image(put(tmp_path / "a.fit", samples.fits_bytes(ramp.astype(">i2"))))
    with pytest.raises(InvalidValueError, match="is no window of 40 lines"):
        image.read(lines=window)


def test_a_window_of_a_huge_image_needs_little_memory(samples, tmp_path) -> None:
    size = 30000
    with (tmp_path / "a.img").open("wb") as stream:
        stream.truncate(2 * size * size)
    label = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"', lines=size, samples=size)
    path = put(tmp_path / "a.lbl", label)
    open_image(path)  # imports
    tracemalloc.start()
    image = open_image(path)
    values = image.read(lines=slice(29000, 29010), samples=slice(10, 20)).values
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert values.shape == (10, 10)
    assert peak < 4_000_000


def test_every_line_of_a_label_corrupted_once(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    put(tmp_path / "a.dat", ramp.astype("<u2").tobytes())
    labels = {
        "a.lbl": samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"'),
        "a.xml": samples.pds4_text("a.dat", 2400, "UnsignedLSB2"),
        "a.cub": samples.isis_bytes(ramp, "UnsignedWord")[:4096].decode(),
    }
    tail = {"a.cub": samples.isis_bytes(ramp, "UnsignedWord")[4096:]}
    refused = 0
    for name, text in labels.items():
        lines = text.splitlines(keepends=True)
        for number in range(len(lines)):
            for new in ("", "\x00\xff = (((\n", lines[number].replace("=", "= -")):
                changed = "".join([*lines[:number], new, *lines[number + 1 :]])
                head = changed.encode("latin-1")
                if name in tail:
                    head = head.ljust(4096, b"\0")[:4096] + tail[name]
                put(tmp_path / name, head)
                try:
                    image = open_image(tmp_path / name)
                    image.read()
                    image.label.mid_exposure()
                except SpcolaError:
                    refused += 1
    assert refused > 60


def test_threads_do_not_disturb_each_other(samples, tmp_path, ramp) -> None:
    paths = []
    for number in range(20):
        paths.append(put(tmp_path / f"{number}.fit", samples.fits_bytes(ramp.astype(">i2"))))
        paths.append(write_raster(tmp_path / f"{number}.png", "PNG", [ramp]))
    before = list(warnings.filters)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda path: open_image(path).read().values, paths):
            np.testing.assert_array_equal(found, ramp)
    assert list(warnings.filters) == before
