"""Images of missions: what their files state, and their pixels against GDAL's."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import rasterio

from spcola.camera.detector import Orientation, Preparation, prepare_pixels
from spcola.errors import FormatError
from spcola.formats.images import open_image

pytestmark = pytest.mark.real_data
EROS = "eros/m0126360726f4_2p_cif_gbl"


def by_gdal(path):
    with warnings.catch_warnings(action="ignore"), rasterio.open(path) as dataset:
        return dataset.read(1)


def test_the_eros_frame_is_one_image_by_any_of_its_three_files(shared_data) -> None:
    images = [open_image(shared_data / f"{EROS}.{ending}") for ending in ("fit", "lbl", "xml")]
    first = images[0].read()
    for image in images:
        assert (image.width, image.height, image.bits, image.byte_order) == (537, 412, 32, ">")
        assert image.pixel_path.name == "m0126360726f4_2p_cif_gbl.fit"
        np.testing.assert_array_equal(image.read().values, first.values)
        mid = image.label.mid_exposure()
        assert mid is not None
        # The header's clock of the middle, 126360726.4195, is start plus half of 999 ms.
        assert mid.source == "start_and_exposure"
        assert mid.et == pytest.approx(4222564.5977, abs=1e-4)
        assert image.label.exposure_s == pytest.approx(0.999)
        assert image.label.clock_start == "126360725.920"
        assert 244.1 in image.label.temperatures_k.values()
    assert first.values.max() == pytest.approx(0.0014194, rel=1e-5)
    np.testing.assert_array_equal(by_gdal(shared_data / f"{EROS}.lbl"), first.values)


def test_the_eros_labels_contradict_each_other_in_orientation(shared_data) -> None:
    assert open_image(shared_data / f"{EROS}.lbl").label.orientation == Orientation("up", "right")
    image = open_image(shared_data / f"{EROS}.xml")
    assert image.label.orientation is None
    assert any("sample left and line up, sample right" in note for note in image.notes)
    # GDAL follows the PDS4 label's first statement without a word: its pixels are turned by 180°.
    turned = Orientation("up", "left").apply(image.read().values)
    np.testing.assert_array_equal(by_gdal(shared_data / f"{EROS}.xml"), turned)


def test_the_navcam_cube(shared_data) -> None:
    path = shared_data / "isis_cubes/20200303T213031S138_ncm_L0-reduced.cub"
    image = open_image(path)
    assert (image.width, image.height, image.bits) == (259, 194, 16)
    label = image.label
    assert (label.target, label.instrument, label.filter) == ("Bennu", "NAVCam", "Monochrome")
    assert label.exposure_s == pytest.approx(0.0042976)
    assert label.temperatures_k["CameraHeadTemperature"] == pytest.approx(273.15 - 28.89233)
    mid = label.mid_exposure()
    assert mid is not None
    # The label gives the same middle as ephemeris time.
    stated = label.keywords["IsisCube"]["Instrument"]["EphemerisTime"]["value"]
    assert mid.et == pytest.approx(stated, abs=1e-5)
    pixels = image.read()
    np.testing.assert_array_equal(pixels.values, by_gdal(path) + 32768.0)
    assert (pixels.values.min(), pixels.values.max()) == (194, 4095)


def test_the_other_cubes(shared_data) -> None:
    nac = open_image(shared_data / "isis_cubes/M143947267L.cal.echo.crop.cub")
    assert nac.label.line_exposure_s == pytest.approx(0.3632e-3)
    assert nac.label.exposure_s is None
    assert nac.read().valid.all()
    for number in (297, 298, 299):
        image = open_image(shared_data / f"apollo15/AS15-M-0{number}_crop.cub")
        assert image.label.start_utc is not None
        assert (image.width, image.height, image.label.target) == (500, 500, "MOON")
        assert image.read(lines=slice(10, 20)).values.shape == (10, 500)
    with pytest.raises(FormatError, match="has 12584 bytes, its label needs"):
        open_image(shared_data / "apollo15/Test_PVL.lbl")


def test_navcam_frames_of_67p_and_their_thresholds(shared_data) -> None:
    paths = sorted((shared_data / "rosetta_67p/navcam/images").glob("*.png"))
    assert len(paths) == 70
    for path in paths[::10]:
        pixels = open_image(path).read()
        prepared = prepare_pixels(pixels, Preparation())
        np.testing.assert_array_equal(prepared.stored.dn, pixels.values)
        low, high = prepared.thresholds
        assert (pixels.values.shape, high) == ((512, 512), 255)
        # Sky around the nucleus is a few DN; lit ground goes up to 255.
        assert np.median(pixels.values[:20]) < low < 40
        assert 0.02 < np.mean(pixels.values >= low) < 0.5


def test_vesta_frames_are_grey_stored_as_colour(shared_data) -> None:
    for path in sorted((shared_data / "vesta/images").glob("*.png"))[:2]:
        pixels = open_image(path).read()
        assert pixels.values.shape == (1024, 1024)
        assert pixels.valid.all()
