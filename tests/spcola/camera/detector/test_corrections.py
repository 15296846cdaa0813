"""Dark frame, flat field and frame-transfer smear: planted frames come back."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.camera.detector import BitDepth, PixelValues, Preparation, prepare_pixels
from spcola.camera.detector.frames import divide_flat, subtract_dark
from spcola.camera.detector.smear import FrameTransfer, remove_smear
from spcola.errors import InvalidValueError

LINES, SAMPLES = 48, 9
T, T2, T0 = 5e-3, 3.75e-6, 5e-6


@pytest.fixture
def scene():
    """Brightness of a body with sharp edges (lines, samples)."""
    rng = np.random.default_rng(3)
    scene = rng.lognormal(5.0, 1.0, (LINES, SAMPLES))
    scene[:10] = 0.0
    scene[30:, :4] *= 20.0
    return scene


def pixels_of(values, *, missing=None, saturated=None):
    none = np.zeros(values.shape, dtype=bool)
    return PixelValues(
        values,
        none if missing is None else missing,
        none,
        none if saturated is None else saturated,
    )


def photographed(scene, clearing):
    """What a frame-transfer detector gives, by moving each packet of charge line by line.

    The memory is before line 0. A packet that clearing leaves at line l came from the last line.
    """
    seen = np.zeros_like(scene)
    for line in range(len(scene)):
        charge = np.zeros(scene.shape[1])
        if clearing:
            for place in range(len(scene) - 1, line, -1):
                charge += T0 * scene[place]
        charge += T * scene[line]
        for place in range(line - 1, -1, -1):
            charge += T2 * scene[place]
        seen[line] = charge / T
    return seen


@pytest.mark.parametrize("clearing", [False, True])
@pytest.mark.parametrize("side", ["first line", "last line"])
def test_smear_is_removed_to_rounding(scene, side, clearing) -> None:
    order = slice(None, None, 1 if side == "first line" else -1)
    smeared = photographed(scene[order], clearing)[order]
    assert np.max(np.abs(smeared - scene)) > 50.0
    transfer = FrameTransfer(T, T2, T0 if clearing else 0.0, side)
    clear = remove_smear(pixels_of(smeared), transfer).values
    np.testing.assert_allclose(clear, scene, rtol=0, atol=1e-12 * scene.max())


def test_full_height_frames_do_not_lose_digits() -> None:
    scene = np.random.default_rng(1).uniform(0, 4000, (1024, 3))
    a, b = 3.84e-3 / 1024 / 1e-3, 5e-3 / 1024 / 1e-3
    before = np.cumsum(scene, axis=0) - scene
    after = scene.sum(axis=0) - scene - before
    transfer = FrameTransfer(1e-3, a * 1e-3, b * 1e-3)
    clear = remove_smear(pixels_of(scene + a * before + b * after), transfer).values
    np.testing.assert_allclose(clear, scene, rtol=0, atol=1e-8)


def test_a_gap_smears_like_its_neighbour_and_stays_a_gap(scene) -> None:
    scene[20:23] = scene[20]
    smeared = photographed(scene, clearing=False)
    missing = np.zeros(scene.shape, dtype=bool)
    missing[21, 2] = True
    smeared[21, 2] = np.nan
    clear = remove_smear(pixels_of(smeared, missing=missing), FrameTransfer(T, T2))
    assert np.isnan(clear.values[21, 2])
    # The neighbour's observed brightness, with its smear, takes the gap's place.
    error = np.abs(clear.values - scene)[~missing]
    assert error.max() < T2 / T * 2 * (smeared[20, 2] - scene[20, 2]) + 1e-9
    others = np.arange(SAMPLES) != 2
    np.testing.assert_allclose(clear.values[:, others], scene[:, others], atol=1e-9)


def test_dark_and_flat_come_back() -> None:
    rng = np.random.default_rng(5)
    scene = rng.uniform(100, 4000, (20, 30))
    flat = rng.uniform(0.8, 1.2, scene.shape)
    dark = rng.uniform(90, 110, scene.shape)
    raw = scene * flat / flat.mean() + 0.25 * dark
    clear = divide_flat(subtract_dark(pixels_of(raw), dark, scale=0.25), 7.0 * flat)
    np.testing.assert_allclose(clear.values, scene, rtol=1e-13)
    level = subtract_dark(pixels_of(scene + 12.0), np.full((1, 1), 12.0))
    np.testing.assert_allclose(level.values, scene, rtol=1e-13)
    lines = np.arange(20.0)[:, None]
    np.testing.assert_allclose(subtract_dark(pixels_of(scene + lines), lines).values, scene)


def test_unknown_calibration_makes_missing_pixels() -> None:
    values = np.full((3, 4), 50.0)
    dark, flat = np.zeros((3, 4)), np.ones((3, 4))
    dark[0, 1] = np.nan
    flat[2, 3] = 0.0
    found = divide_flat(subtract_dark(pixels_of(values), dark), flat)
    assert np.argwhere(found.missing).tolist() == [[0, 1], [2, 3]]
    np.testing.assert_allclose(found.values[found.valid], 50.0)


def test_the_chain_runs_in_the_order_of_the_detector(scene) -> None:
    rng = np.random.default_rng(8)
    flat = rng.uniform(0.9, 1.1, scene.shape)
    flat /= flat.mean()
    dark = rng.uniform(50, 60, scene.shape)
    raw = photographed(scene * flat, clearing=False) + dark
    preparation = Preparation(
        dark=dark, flat=flat, smear=FrameTransfer(T, T2), depth=BitDepth(16, 3.0, 10.0)
    )
    prepared = prepare_pixels(pixels_of(raw), preparation)
    expected = np.clip(np.rint(3.0 * scene + 10.0), 0, 65535)
    assert np.max(np.abs(prepared.stored.dn - expected)) <= (1 if expected.max() < 65535 else 0)


def test_a_square_root_encoding_is_undone(scene) -> None:
    encoded = np.rint(255.0 * np.sqrt(scene / scene.max())).astype(np.uint8)
    prepared = prepare_pixels(pixels_of(encoded), Preparation(gamma=2.0))
    assert prepared.stored.dn.dtype == np.uint16
    bright = scene > 0.1 * scene.max()
    ratio = prepared.stored.dn[bright] / scene[bright]
    # A step of the encoded numbers is 2 / 80 of the brightness there.
    np.testing.assert_allclose(ratio, np.median(ratio), rtol=0.014)
    with pytest.raises(InvalidValueError, match="gamma"):
        Preparation(gamma=0.0)


@pytest.mark.parametrize(
    "times", [(0.0, 1e-6, 0.0), (1.0, -1e-6, 0.0), (1e-3, 2e-3, 0.0), (np.nan, 1e-6, 0.0)]
)
def test_impossible_times_are_refused(times) -> None:
    with pytest.raises(InvalidValueError, match="frame transfer"):
        FrameTransfer(*times)


def test_frames_of_another_shape_are_refused() -> None:
    pixels = pixels_of(np.ones((4, 5)))
    with pytest.raises(InvalidValueError, match="dark frame: has shape"):
        subtract_dark(pixels, np.ones((5, 4)))
    with pytest.raises(InvalidValueError, match="flat field: has shape"):
        divide_flat(pixels, np.ones((1, 1)))
    with pytest.raises(InvalidValueError, match="no positive pixel"):
        divide_flat(pixels, np.zeros((4, 5)))
