"""Raw frames: bias, dark current, flat field, smear, noise, and the labels of their files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from spcola.errors import SettingsError
from spcola.navigation import et_from_utc
from spcola.truth.raw_frames import (
    Detector,
    DetectorSettings,
    RawLabel,
    write_calibration,
    write_raw_image,
)

SIZE = 128
SETTINGS = DetectorSettings()
LABEL = RawLabel("PolyCam", "DS", 612705669.5, 0.0251, -17.25, "1/0001728000.11243")


def a_detector(settings: DetectorSettings = SETTINGS, camera: str = "PolyCam") -> Detector:
    return Detector.drawn(settings, camera, SIZE, np.random.default_rng(4))


def test_a_dark_frame_is_bias_and_dark_current_which_doubles_by_7_k() -> None:
    detector = a_detector()
    dark = np.zeros((SIZE, SIZE))
    cold = detector.signal(dark, 10.0, -20.0) - SETTINGS.bias
    warm = detector.signal(dark, 10.0, -13.0) - SETTINGS.bias
    assert warm == pytest.approx(2.0 * cold)
    assert np.median(cold) == pytest.approx(10.0 * SETTINGS.dark_rate, rel=0.1)
    assert np.mean(cold > 20 * np.median(cold)) == pytest.approx(3e-4, abs=3e-4)


def test_light_smears_along_its_column_by_the_time_of_the_transfer() -> None:
    detector = a_detector(replace(SETTINGS, dark_rate=0.0, transfer=1e-3))
    iof = np.zeros((SIZE, SIZE))
    iof[40:60, 70] = 0.03
    frame = detector.signal(iof, 0.02, -20.0) - SETTINGS.bias
    light = SETTINGS.responsivity_of("PolyCam") * 0.03 * detector.flat[40:60, 70].sum()
    assert frame[:40, 70] == pytest.approx(1e-3 * light / SIZE)
    assert np.all(frame[:, 69] == 0.0)
    assert frame.sum() == pytest.approx(light * (0.02 + 1e-3))


def test_noise_is_that_of_electrons_and_reading() -> None:
    flat = replace(SETTINGS, dark_rate=0.0, transfer=0.0, flat_noise=0.0, vignetting=0.0)
    detector = a_detector(flat)
    exposure = flat.exposure_for(0.03, "PolyCam")
    frame = detector.frame(
        np.full((SIZE, SIZE), 0.03), exposure=exposure, temperature_c=-20.0,
        generator=np.random.default_rng(1),
    )  # fmt: skip
    signal = frame.mean() - flat.bias
    gain = flat.full_well / flat.largest
    assert signal == pytest.approx(flat.exposure_share * (flat.largest - flat.bias), rel=0.01)
    expected = signal / gain + (flat.read_noise / gain) ** 2 + 1.0 / 12.0
    assert frame.var() == pytest.approx(expected, rel=0.04)


def test_numbers_are_of_12_bits_in_16_and_saturate() -> None:
    frame = a_detector().frame(
        np.full((SIZE, SIZE), 1.0), exposure=1.0, temperature_c=-20.0,
        generator=np.random.default_rng(1),
    )  # fmt: skip
    assert frame.dtype == np.int16
    assert (frame == 4095).all()


def test_the_label_is_complete_and_says_nothing_of_the_state(tmp_path: Path) -> None:
    detector = a_detector()
    pixels = np.arange(SIZE * SIZE, dtype=np.int16).reshape(SIZE, SIZE) % 4096
    path = tmp_path / f"{LABEL.product}.fits"
    write_raw_image(path, pixels, LABEL, detector)
    with fits.open(path) as units:
        header = units[0].header
        assert np.array_equal(units[0].data, pixels)
    assert (header["BITPIX"], header["NAXIS1"], header["NAXIS2"]) == (16, SIZE, SIZE)
    assert (header["INSTRUME"], header["FILTER"], header["TARGET"]) == (
        "POLYCAM", "CLEAR", "BLINDBODY",
    )  # fmt: skip
    assert (header["EXPTIME"], header["CCDTEMP"], header["BITDEPTH"]) == (0.0251, -17.25, 12)
    start, end, middle = (et_from_utc(header[key]) for key in ("DATE-OBS", "DATE-END", "DATE-AVG"))
    assert start == pytest.approx(LABEL.time - 0.01255, abs=2e-6)
    assert end - start == pytest.approx(LABEL.exposure, abs=2e-6)
    assert middle == pytest.approx(LABEL.time, abs=2e-6)
    assert header["MPHASE"] == "DETAILED SURVEY"
    assert header["LINEDISP"] == "DOWN"
    assert not {"SCOBJ_X", "CX_X", "K_11", "IMGNAME"} & set(header)
    assert LABEL.product == "20190602T000000S315_pol_raw"


def test_calibration_frames_undo_what_the_detector_did(tmp_path: Path) -> None:
    detector = a_detector()
    dark_file, flat_file = write_calibration(tmp_path, detector)
    iof = 0.02 + 0.01 * np.random.default_rng(2).random((SIZE, SIZE))
    signal = detector.signal(iof, 0.05, -13.0)
    with fits.open(dark_file) as dark, fits.open(flat_file) as flat:
        header = dark[0].header
        warm = 2.0 ** ((-13.0 - header["CCDTEMP"]) / header["DOUBLING"])
        rest = signal - header["BIAS"] - warm * dark[0].data * (0.05 + 0.5 * SETTINGS.transfer)
        # Smear of a column in steady light: its mean, by the time of the transfer.
        rest -= rest.mean(axis=0) * SETTINGS.transfer / (0.05 + SETTINGS.transfer)
        found = rest / flat[0].data / header["IOFRESP"] / 0.05
    assert found == pytest.approx(iof, rel=1e-4)


@pytest.mark.parametrize("changes", [{"bits": 11}, {"bias": 4000.0}, {"full_well": 0.0}])
def test_impossible_detectors_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(SettingsError):
        replace(SETTINGS, **changes)
