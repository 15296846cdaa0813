"""Fits of photometric functions: planted parameters, pulls, what is undetermined or alike."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import NotObservableError
from spcola.photometry import OrthoImage
from spcola.photometry.fitting import (
    Doubt,
    PhotometricSamples,
    SampleOptions,
    compare_fits,
    fit_function,
    sample_blocks,
)
from spcola.photometry.fitting.slope_errors import slope_error, slope_response
from spcola.photometry.functions import PhotometricFunction, photometric_function
from spcola.photometry.ortho_image import View

PLACES, EACH = 40, 6


def planted(
    phi: PhotometricFunction,
    seed: int = 0,
    *,
    noise: float = 0.02,
    common: float = 0.03,
    tilt: float = 0.5,
    wrong: float = 0.0,
) -> PhotometricSamples:
    """24 images of places whose points face about up; an albedo error is common to a place.

    Cosines are those of normals that are wrong by that angle, common to all images.
    """
    rng = np.random.default_rng(seed)
    suns = np.radians(rng.uniform([0, 5], [360, 60], (24, 2)))
    eyes = np.radians(rng.uniform([0, 0], [360, 50], (24, 2)))
    image = np.repeat(np.arange(24), PLACES * EACH)
    place = np.tile(np.repeat(np.arange(PLACES), EACH), 24)
    normal = np.random.default_rng(1).normal(0.0, tilt, (PLACES * EACH, 3))
    normal += [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    given = normal + wrong * np.random.default_rng(seed + 1000).normal(size=normal.shape)
    given /= np.linalg.norm(given, axis=1, keepdims=True)
    normal, given = (np.tile(one, (24, 1)) for one in (normal, given))
    sun, eye = (
        np.stack([np.cos(a) * np.sin(z), np.sin(a) * np.sin(z), np.cos(z)], axis=1)[image]
        for a, z in (suns.T, eyes.T)
    )
    true, cosines = (
        np.stack([np.sum(one * sun, axis=1), np.sum(one * eye, axis=1)]) for one in (normal, given)
    )
    phase = np.arccos(np.clip(np.sum(sun * eye, axis=1), -1, 1))
    good = (cosines > 0.25).all(axis=0) & (true > 0.25).all(axis=0)
    albedo = 1.0 + rng.normal(0.0, common, PLACES)[place]
    bright = albedo * phi(*true, phase) * rng.uniform(50, 500, 24)[image]
    bright = bright[good]
    level = np.bincount(image[good], bright) / np.bincount(image[good])
    bright = bright / level[image[good]] + rng.normal(0.0, noise, bright.size)
    index = np.arange(bright.size)
    return PhotometricSamples(
        bright, image[good], place[good], index, cosines[:, good], phase[good], np.ones(index.size)
    )


@pytest.mark.parametrize(
    "text",
    [
        "minnaert k=0.7 k_slope=0.002",
        "lunar-lambert-exponential alpha0=45",
        "akimov-phase eta=0.4 slope=-0.01",
        "hapke-rough-two-lobes w=0.4 B0=0.5 h=0.1 b=0.3 c=0.4 theta_bar=24",
    ],
)
def test_planted_parameters_are_found_without_noise(text: str) -> None:
    phi = photometric_function(text)
    start = photometric_function(phi.name)
    found = fit_function(planted(phi, noise=0.0, common=0.0), start)
    assert found.converged
    for one, value, wanted in zip(phi.parameters, found.function.values, phi.values, strict=True):
        if one.name not in found.doubts:
            assert value == pytest.approx(wanted, rel=2e-3, abs=1e-4), one.name
    known = {one.name for one in phi.parameters} - set(found.doubts)
    assert {"k", "k_slope", "alpha0", "eta", "theta_bar"} & {
        p.name for p in phi.parameters
    } <= known


def test_sigmas_are_those_of_the_errors() -> None:
    phi = photometric_function("minnaert k=0.7 k_slope=0.002")
    start = photometric_function("minnaert")
    pulls = []
    for seed in range(40):
        found = fit_function(planted(phi, seed), start)
        pulls.append((np.array(found.function.values) - phi.values) / found.sigma)
    assert 0.8 < np.std(pulls) < 1.25
    assert np.abs(np.mean(pulls, axis=0)).max() < 3.0 / np.sqrt(40)


@pytest.mark.parametrize("wrong", [0.03, 0.06, 0.1])
def test_sigmas_contain_what_wrong_slopes_do_to_all_places_alike(wrong: float) -> None:
    """Brightness over wrong slopes has less contrast: k comes out too small, everywhere."""
    phi = photometric_function("minnaert k=0.7 k_slope=0.002")
    pulls, seen, sigmas = [], [], []
    for seed in range(12):
        found = fit_function(planted(phi, seed, wrong=wrong), photometric_function("minnaert"))
        pulls.append((np.array(found.function.values) - phi.values) / found.sigma)
        seen.append(found.slope_sigma)
        sigmas.append(found.sigma[0])
    assert np.mean(seen) == pytest.approx(wrong, rel=0.1)
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert 0.3 < rms.min() < rms.max() < 1.2
    right = fit_function(planted(phi), photometric_function("minnaert"))
    assert right.slope_sigma < 0.005
    assert np.mean(sigmas) > 2.0 * right.sigma[0]


def test_slope_errors_are_separated_from_noise_and_albedo() -> None:
    rng = np.random.default_rng(3)
    fitted, response = rng.uniform(0.3, 1.5, 5000), rng.uniform(0.0, 2.0, 5000)
    other = rng.normal(0.0, 0.01, 5000) + fitted * rng.normal(0.0, 0.02, 5000)
    residual = other + response * rng.normal(0.0, 0.03, 5000)
    residual[::50] += 1.0
    assert slope_error(residual, fitted, response) == pytest.approx(0.03, rel=0.1)
    assert slope_error(other, fitted, response) < 0.005
    assert slope_error(0.0 * other, fitted, response) < 1e-6


def test_the_response_is_that_to_the_steepest_tilt() -> None:
    """Against differences between normals that are tilted in all directions, of two albedos."""
    phi = photometric_function("minnaert k=0.7 k_slope=0.002")
    sun, eye = np.array([[0.5, 0.1, 0.86], [-0.2, 0.6, 0.77]])
    sun, eye = sun / np.linalg.norm(sun), eye / np.linalg.norm(eye)
    phase = np.arccos(sun @ eye)
    turns = np.radians(np.arange(360.0))
    tilt = 1e-5 * np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
    normal = tilt + np.array([0.0, 0.0, 1.0])
    away = phi(normal @ sun, normal @ eye, np.full(360, phase)) - phi(sun[2], eye[2], phase)
    two = np.ones(2)
    samples = PhotometricSamples(
        two, np.zeros(2, dtype=int), np.arange(2), np.arange(2),
        np.outer([sun[2], eye[2]], two), phase * two, np.array([1.0, 2.0]),
    )  # fmt: skip
    steepest = away.max() / 1e-5
    assert slope_response(samples, phi) == pytest.approx([steepest, 2.0 * steepest], rel=1e-3)


def test_the_function_with_which_it_was_made_is_preferred() -> None:
    truth = photometric_function("minnaert k=0.75 k_slope=0")
    samples = planted(truth)
    fits = [
        fit_function(samples, photometric_function(name))
        for name in ("lambert", "lommel-seeliger", "minnaert", "lunar-lambert-exponential")
    ]
    found = compare_fits(samples, fits)
    assert found.standings[0].fit.function.name == "minnaert"
    by_name = {one.fit.function.name: one for one in found.standings}
    assert not by_name["lambert"].as_good
    assert not by_name["lommel-seeliger"].as_good
    assert 40 < found.independent < len(samples)


def test_phase_functions_are_undetermined_unless_images_share_a_scale() -> None:
    """λ of each image absorbs a phase function; data that are too alike distinguish nothing."""
    phi = photometric_function("lommel-seeliger-exponential a=-0.03 b=2e-4 c=0")
    samples = planted(phi)
    start = photometric_function("lommel-seeliger-exponential")
    found = fit_function(samples, start)
    assert {code for code, _ in found.doubts.values()} == {Doubt.UNDETERMINED}
    alone = fit_function(samples, photometric_function("lommel-seeliger"))
    ranked = compare_fits(samples, [alone, found]).standings
    assert ranked[0].fit is alone
    assert ranked[1].as_good


def test_outliers_and_flat_ground() -> None:
    phi = photometric_function("minnaert k=0.7")
    samples = planted(phi, common=0.0)
    samples.brightness[::17] *= 0.3
    found = fit_function(samples, photometric_function("minnaert"))
    assert abs(found.function.values[0] - 0.7) < 4.0 * found.sigma[0] < 0.05
    # On a plane every point of an image has one brightness.
    flat = fit_function(planted(phi, tilt=1e-4), photometric_function("minnaert"))
    assert {code for code, _ in flat.doubts.values()} == {Doubt.UNDETERMINED}


def test_too_few_samples_are_refused() -> None:
    samples = planted(photometric_function("lambert"))
    few = PhotometricSamples(
        samples.brightness[:9], samples.image[:9], samples.place[:9], samples.start[:9],
        samples.cosines[:, :9], samples.phase[:9], samples.albedo[:9],
    )  # fmt: skip
    with pytest.raises(NotObservableError, match="only 9 places"):
        fit_function(few, photometric_function("minnaert"))


def test_blocks_are_where_all_is_seen_and_lit() -> None:
    """A shadow, a saturated point and steep light leave blocks out; means are those of cells."""
    size, cells = 49, 48
    lit = np.ones((size, size), dtype=bool)
    lit[:10, :10] = False
    exposed = np.ones((size, size), dtype=bool)
    exposed[30, 30] = False
    light = np.cos(np.radians(30.0)) * np.ones((cells, cells))
    light[:, :4] = 0.1
    ramp = np.tile(np.arange(size, dtype=float), (size, 1))
    view = View(
        "N1", ramp, ramp.T, np.ones_like(lit), lit, light, np.ones((cells, cells)),
        np.full((cells, cells), np.radians(30.0)), 0.5 * np.eye(2),
    )  # fmt: skip
    ortho = OrthoImage(view, 100.0 + ramp, exposed, ~exposed)
    albedo = np.ones((size, size))
    found = sample_blocks(ortho, albedo, SampleOptions(most=1000))
    assert found is not None
    # Twelve blocks of 4 × 4 cells along a side; a pixel is two cells wide.
    dark = np.zeros((12, 12), dtype=bool)
    dark[:3, :3] = dark[7, 7] = dark[:, :2] = True
    assert found.brightness.size <= (~dark).sum()
    assert found.cosines.shape == (2, found.brightness.size, 16)
    assert found.cosines[0].min() > 0.8
    middles = 100.0 + 4.0 * np.arange(12) + 2.0
    assert set(found.brightness.tolist()) <= set(middles.tolist())
    assert set(found.part.tolist()) == {0, 1, 2, 3}
    few = sample_blocks(ortho, albedo, SampleOptions(most=10))
    assert few is not None
    assert 5 <= few.brightness.size <= 10
    albedo[:] = np.nan
    assert sample_blocks(ortho, albedo) is None
