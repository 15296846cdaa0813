"""The nearest camera with Owen's distortion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.camera import Camera
from spcola.camera.owen_fit import camera_difference, fit_owen
from spcola.errors import InvalidValueError

LENS = Camera(150.0, [500.0, 520.0], [[71.4, 0.1, 0.01], [-0.1, -71.0, 0.02]], 1024, 1000)


def test_what_owens_model_holds_comes_back() -> None:
    owen = replace(LENS, distortion=[2e-5, 3e-8, 1e-5, -2e-5])
    six = replace(LENS, distortion=[0.0, 2e-5, 0.0, 3e-8, 1e-5, -2e-5])
    np.testing.assert_allclose(fit_owen(six, whole=False).distortion, owen.distortion, rtol=1e-6)
    assert camera_difference(six, owen).largest_px < 1e-9


def test_linear_terms_are_fitted_by_the_whole_camera_alone() -> None:
    # dx = 0.01 + 1e-3 x − 2e-3 y, dy = −0.02 + 2e-3 x.
    values = np.zeros(20)
    values[[0, 1, 2, 10, 11]] = [0.01, 1e-3, -2e-3, -0.02, 2e-3]
    bent = replace(LENS, k_matrix=LENS.k_matrix * [1, 1, 0], distortion_model="bicubic",
                   distortion=values)  # fmt: skip
    found = fit_owen(bent, whole=True)
    assert camera_difference(bent, found).largest_px < 1e-7
    assert not found.distortion.any()
    assert camera_difference(bent, fit_owen(bent, whole=False)).largest_px > 0.5


def test_pixels_of_difference_are_those_that_were_planted() -> None:
    moved = replace(LENS, center=LENS.center + np.array([3.0, -4.0]))
    found = camera_difference(LENS, moved)
    assert found.rms_px == pytest.approx(5.0)
    assert found.largest_px == pytest.approx(5.0)


def test_a_camera_that_folds_over_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="folds over on"):
        fit_owen(replace(LENS, distortion_model="brown", distortion=[-900.0, 0, 0, 0]), whole=True)
