"""What SPC keeps of the relief."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from fusion.surfacematch.resolution import blur, estimate_transfer


def surfaces(count, cells, noise):
    """Pairs of rough ground and the same smoothed, with noise over five cells and 1 % of gaps."""
    pairs = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        ground = ndimage.gaussian_filter(rng.normal(size=(140, 140)), 1.0)[20:119, 20:119]
        ground /= ground.std()
        error = ndimage.gaussian_filter(rng.normal(size=ground.shape), 2.5)
        soft = (
            blur(ground, cells)
            + noise * error / error.std()
            - 0.01 * np.hypot(*np.indices((99, 99)))
        )
        lidar = ground - 0.01 * np.hypot(*np.indices((99, 99)))
        lidar[rng.random(ground.shape) < 0.01] = np.nan
        pairs.append((lidar, soft))
    return pairs


def test_gain_is_that_of_the_smoothing_whatever_the_noise():
    found = estimate_transfer(surfaces(12, 1.2, 0.5))
    planted = np.exp(-2.0 * np.pi**2 * 1.2**2 * found.wavenumber**2)
    determined = (found.wavenumber > 0.05) & (planted > 0.1)
    np.testing.assert_allclose(found.gain[determined], planted[determined], atol=0.07)
    # Noise lies at long waves, where it hides what is common.
    assert found.coherence[1] < 0.6 < found.coherence[determined].max()


def test_equal_surfaces_have_gain_one_and_none_give_no_transfer():
    pairs = [(lidar, lidar) for lidar, _ in surfaces(2, 1.0, 0.0)]
    found = estimate_transfer(pairs)
    np.testing.assert_allclose(found.gain, 1.0, atol=1e-9)
    np.testing.assert_allclose(found.coherence, 1.0, atol=1e-9)
    assert estimate_transfer([]) is None
    assert estimate_transfer([(np.full((99, 99), np.nan),) * 2]) is None
