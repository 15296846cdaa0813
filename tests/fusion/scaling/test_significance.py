from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import dct
from scipy.ndimage import gaussian_filter1d

from fusion.scaling.misplacement.fit import PlaceFit
from fusion.scaling.misplacement.significance import chance_of_fit, chance_of_larger, drawn

PRIOR = np.array([0.01, 10.0, 10.0, 10.0, 0.002, 0.002, 0.02, 0.03])
PLACES = 300


def smooth(generator, size, reach):
    """Series of variance 1 along the last axis, correlated over `reach` of it."""
    white = generator.normal(size=(*size[:-1], size[-1] + 80))
    if not reach:
        return white[..., 40:-40]
    series = gaussian_filter1d(white, reach / np.sqrt(2.0), axis=-1)[..., 40:-40]
    return series * np.sqrt(np.sqrt(2.0 * np.pi) * reach)


def fits(values, generator):
    """Shots of a short track at places with these values: centre and size are smooth along it."""
    design = smooth(generator, (8, values.shape[1]), 10.0).T * [100.0, 1, 1, 1, 100, 100, 100, 1]
    met = np.ones(values.shape[1], dtype=bool)
    return [PlaceFit(met, value, design) for value in values]


def chances(values, generator, prior=PRIOR):
    """Both chances that the first of the values (P + 1, N) are not of the right place."""
    here, *others = fits(values, generator)
    rests = [fit.rest(prior) for fit in others]
    best = min(rests, key=lambda rest: float(np.std(rest)))
    paired = len(others) * chance_of_larger(here.rest(prior), best)
    if paired >= 1e-3:
        return paired, 0.0
    noise = chance_of_fit(here, others, prior=prior, loose=prior, center=np.zeros(8))
    return paired, noise


def test_noise_has_the_spectrum_of_the_residuals_and_not_their_course():
    rest = smooth(np.random.default_rng(1), (60,), 4.0)
    noise = drawn(rest, 50)
    waves = np.abs(dct(noise, axis=0, norm="ortho"))
    assert waves == pytest.approx(np.abs(dct(rest, norm="ortho"))[:, None] * np.ones(50))
    assert np.max(np.abs(noise.T @ rest) / (rest @ rest)) < 0.95


def test_squares_are_those_of_the_fit():
    generator = np.random.default_rng(2)
    fit = fits(generator.uniform(-1.0, 1.0, size=(1, 40)), generator)[0]
    here = generator.normal(size=40)
    here[3] = np.nan
    noise = np.where(np.isfinite(here), here, 0.0)[:, None] * np.ones(2)
    noise[5, 1] += 0.1
    seen = np.isfinite(here)
    part = PlaceFit(seen[seen], fit.value[seen], fit.design[seen])
    exact = np.linalg.lstsq(
        np.concatenate([part.design, np.diag(fit.error / PRIOR)]) * PRIOR,
        np.concatenate([part.value, np.zeros(8)]),
        rcond=None,
    )[0]
    left = part.value - part.design @ (PRIOR * exact)
    squares = fit.squares(PRIOR, noise, here)
    assert squares[0] == pytest.approx(np.mean(left**2))
    assert squares[1] != pytest.approx(squares[0])


def test_short_tracks_of_correlated_errors_give_no_false_alarm():
    """Smooth errors and smooth relief of 26 shots: paired variances alone are too sure of them."""
    generator, alone, both = np.random.default_rng(5), 0, 0
    for _ in range(20):
        error = smooth(generator, (26,), 8.0)
        relief = smooth(generator, (PLACES, 26), 8.0)
        # Nothing for the parameters to explain: they would take what is smooth.
        values = np.vstack([error, error + relief])
        paired, noise = chances(values, generator, prior=1e-6 * PRIOR)
        alone += paired < 1e-3
        both += max(paired, noise) < 1e-3
    assert alone > 0
    assert both == 0


@pytest.mark.parametrize("reach", [0.0, 3.0])
def test_a_track_that_is_elsewhere_is_found(reach):
    """White errors; the relief, four times as large, fits one other place."""
    generator = np.random.default_rng(3)
    error = 0.25 * generator.normal(size=40)
    relief = smooth(generator, (PLACES, 40), reach)
    values = error + np.vstack([relief[0], relief[0] - relief])
    assert max(chances(values, generator)) < 1e-3
