"""Photometric functions: normalisation, limits, symmetry and what lies in the dark."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.photometry.functions import (
    PHOTOMETRIC_FUNCTIONS,
    lambert,
    lommel_seeliger,
    lunar_lambert,
    lunar_weight,
    photometric_function,
)

RNG = np.random.default_rng(0)
COS_I, COS_E = RNG.uniform(0.05, 1.0, size=(2, 200))
PHASE = RNG.uniform(0.0, 2.0, size=200)


@pytest.mark.parametrize("name", PHOTOMETRIC_FUNCTIONS)
def test_all_are_one_at_zero_phase_from_above_and_dark_where_nothing_reaches(name: str) -> None:
    phi = photometric_function(name)
    one, zero = np.ones(1), np.zeros(1)
    assert phi(one, one, zero)[0] == pytest.approx(1.0, abs=1e-15)
    cosines = np.array([0.0, -0.3, 0.5, 0.5, np.nan])
    others = np.array([0.7, 0.7, 0.0, -0.2, 0.5])
    value = phi(cosines, others, np.full(5, 0.4))
    np.testing.assert_array_equal(value[:4], 0.0)
    assert np.isnan(value[4])
    assert (phi(COS_I, COS_E, PHASE) > 0).all()


def test_formulas() -> None:
    lunar = 2 * COS_I / (COS_I + COS_E)
    np.testing.assert_allclose(lommel_seeliger(COS_I, COS_E, PHASE), lunar, rtol=1e-15)
    np.testing.assert_allclose(lambert(COS_I, COS_E, PHASE), COS_I, rtol=1e-15)
    weight = lunar_weight(PHASE)
    mixed = weight * lunar + (1 - weight) * COS_I
    np.testing.assert_allclose(lunar_lambert(COS_I, COS_E, PHASE), mixed, rtol=1e-14)


def test_the_weight_of_mcewen() -> None:
    degrees = np.array([0.0, 30.0, 60.0, 90.0, 150.0])
    expected = [1.0, 1 - 0.57 + 0.2178 - 0.03942, 1 - 1.14 + 0.8712 - 0.31536]
    expected += [1 - 1.71 + 1.9602 - 1.06434, 0.0]
    np.testing.assert_allclose(lunar_weight(np.radians(degrees)), expected, atol=1e-12)
    assert np.all(np.diff(lunar_weight(np.radians(np.arange(0.0, 181.0)))) <= 0)


def test_reciprocity() -> None:
    """Light and view may change places: Φ/μ0 is symmetric in both (Minnaert 1941)."""
    for phi in PHOTOMETRIC_FUNCTIONS.values():
        there, back = phi(COS_I, COS_E, PHASE) / COS_I, phi(COS_E, COS_I, PHASE) / COS_E
        np.testing.assert_allclose(there, back, rtol=1e-13)


def test_another_function_can_be_plugged_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PHOTOMETRIC_FUNCTIONS, "even", lambda i, e, p: np.ones_like(i))
    assert photometric_function("even")(COS_I, COS_E, PHASE).sum() == 200
    with pytest.raises(SettingsError, match="'hapke' is none of lunar-lambert"):
        photometric_function("hapke")
