"""The resolution of models whose smoothing is known by formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from fusion.truth.assessment.resolution import Spectra
from spcola.grids import MapletGrid
from spcola.math import lattice
from spcola.truth.body import BodySettings, TruthBody

GSD, MARGIN, SIZE = 0.4, 20, 99
# A Gaussian of σ has the transfer exp(−2π²σ²/λ²); its square is ½ at this times σ.
HALF = 2.0 * np.pi / np.sqrt(np.log(2.0))


@pytest.fixture(scope="module")
def ground() -> list[np.ndarray]:
    """Heights of the truth body, with a margin so that smoothing has no edge."""
    body = TruthBody(BodySettings(radius=75.0))
    found = []
    for direction in lattice(8):
        center, normal = body.mean_plane(direction, 40.0)
        half_size = SIZE // 2 + MARGIN
        found.append(body.heights(MapletGrid.facing(center, normal, GSD, half_size)))
    return found


def inner(height: np.ndarray) -> np.ndarray:
    return height[MARGIN:-MARGIN, MARGIN:-MARGIN]


def transfer_of(models, truths):
    spectra = Spectra(SIZE, GSD)
    for model, truth in zip(models, truths, strict=True):
        spectra.add(inner(model), inner(truth))
    return spectra.transfer()


@pytest.mark.parametrize("cells", [1.0, 1.5, 2.4])
def test_the_width_of_a_gaussian_is_recovered(ground, cells: float) -> None:
    found = transfer_of([gaussian_filter(h, cells) for h in ground], ground)
    assert found.half_power == pytest.approx(HALF * cells * GSD, rel=0.03)
    expected = np.exp(-2.0 * (np.pi * cells * GSD / found.wavelength) ** 2)
    np.testing.assert_allclose(found.transfer, expected, atol=0.05)
    assert not found.reason


def test_noise_lowers_the_coherence_and_not_what_is_kept(ground) -> None:
    generator = np.random.default_rng(3)
    smooth = [gaussian_filter(h, 1.5) for h in ground]
    noisy = [h + 0.05 * generator.normal(size=h.shape) for h in smooth]
    clean, found = transfer_of(smooth, ground), transfer_of(noisy, ground)
    assert found.half_power == pytest.approx(HALF * 1.5 * GSD, rel=0.05)
    assert found.half_coherence > 1.5 * np.nan_to_num(clean.half_coherence)
    assert found.power_ratio[-1] > 10.0 * clean.power_ratio[-1]


def test_planes_and_scales_of_both_do_not_matter(ground) -> None:
    smooth = [gaussian_filter(h, 1.5) for h in ground]
    rows, columns = np.indices(ground[0].shape)
    tilted = [h + 3.0 + 0.2 * rows - 0.1 * columns for h in smooth]
    assert transfer_of(tilted, ground).half_power == pytest.approx(
        transfer_of(smooth, ground).half_power, rel=1e-9
    )


def test_a_perfect_model_keeps_everything(ground) -> None:
    found = transfer_of(ground, ground)
    np.testing.assert_allclose(found.transfer, 1.0)
    np.testing.assert_allclose(found.coherence, 1.0)
    assert np.isnan(found.half_power)
    assert "more than half is left" in found.reason


def test_a_flat_model_keeps_nothing(ground) -> None:
    found = transfer_of([np.zeros_like(h) for h in ground], ground)
    assert np.isnan(found.half_power)
    assert "less than half" in found.reason


def test_gaps_make_the_windows_smaller(ground) -> None:
    holed = [h.copy() for h in ground]
    for h in holed:
        h[MARGIN + 60, MARGIN + 60] = np.nan
    models = [gaussian_filter(h, 1.0) for h in ground]
    models = [np.where(np.isnan(h), np.nan, m) for h, m in zip(holed, models, strict=True)]
    found = transfer_of(models, ground)
    assert found.windows > 8
    assert found.half_power == pytest.approx(HALF * GSD, rel=0.04)


def test_without_a_whole_window_there_is_a_reason() -> None:
    spectra = Spectra(SIZE, GSD)
    model = np.zeros((SIZE, SIZE))
    model[::5] = np.nan
    spectra.add(model, np.zeros((SIZE, SIZE)))
    found = spectra.transfer()
    assert np.isnan(found.half_power)
    assert "gap" in found.reason
    level = Spectra(SIZE, GSD)
    level.add(np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE)))
    assert "no relief" in level.transfer().reason
