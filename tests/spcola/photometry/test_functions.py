"""Photometric functions: normalisation, derivatives, limits, symmetry and what lies in the dark."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.compilation import compiled
from spcola.errors import SettingsError
from spcola.photometry.functions import (
    PHOTOMETRIC_FUNCTIONS,
    PhotometricFunction,
    lambert,
    lommel_seeliger,
    lunar_lambert,
    phase_terms,
    photometric_function,
    shade,
    shade_at,
)


def angles(count: int = 2000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines of incidence and emission and phase of random directions, none near an edge."""
    rng = np.random.default_rng(0)
    sun, eye = rng.normal(size=(2, count, 3))
    sun, eye = (one / np.linalg.norm(one, axis=1, keepdims=True) for one in (sun, eye))
    across = np.linalg.det(np.stack([sun, eye, np.tile([0.0, 0.0, 1.0], (count, 1))], axis=1))
    # Hapke's roughness has a cusp where the planes of incidence and emission coincide.
    good = (sun[:, 2] > 0.05) & (eye[:, 2] > 0.05) & (np.abs(across) > 0.1)
    return sun[good, 2], eye[good, 2], np.arccos(np.sum(sun * eye, axis=1)[good])


COS_I, COS_E, PHASE = angles()
ALL = list(PHOTOMETRIC_FUNCTIONS.values())


@pytest.mark.parametrize("phi", ALL, ids=lambda phi: phi.name)
def test_all_are_one_at_zero_phase_from_above_and_dark_where_nothing_reaches(
    phi: PhotometricFunction,
) -> None:
    one, zero = np.ones(1), np.zeros(1)
    assert phi(one, one, zero)[0] == pytest.approx(1.0, abs=1e-9)
    assert phi(one - 1e-9, one - 1e-9, zero)[0] == pytest.approx(1.0, abs=1e-4)
    cosines = np.array([0.0, -0.3, 0.5, 0.5, np.nan, 0.5, 0.5])
    others = np.array([0.7, 0.7, 0.0, -0.2, 0.5, np.nan, 0.5])
    phases = np.array([0.4] * 6 + [np.nan])
    found = phi.partials(cosines, others, phases)
    for layer in (found.value, found.by_cos_incidence, found.by_cos_emission):
        np.testing.assert_array_equal(layer[:4], 0.0)
        assert np.isnan(layer[4:]).all() or phi is lambert
    assert np.isnan(found.value[4:]).all()
    assert (phi(COS_I, COS_E, PHASE) > 0).all()


@pytest.mark.parametrize("phi", ALL, ids=lambda phi: phi.name)
def test_derivatives_are_those_of_finite_differences(phi: PhotometricFunction) -> None:
    found, step = phi.partials(COS_I, COS_E, PHASE), 1e-6
    by_i = (phi(COS_I + step, COS_E, PHASE) - phi(COS_I - step, COS_E, PHASE)) / (2 * step)
    by_e = (phi(COS_I, COS_E + step, PHASE) - phi(COS_I, COS_E - step, PHASE)) / (2 * step)
    np.testing.assert_allclose(found.by_cos_incidence, by_i, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(found.by_cos_emission, by_e, rtol=1e-6, atol=1e-7)
    by_parameters = phi.by_parameters(COS_I, COS_E, PHASE)
    assert by_parameters.shape == (len(phi.parameters), COS_I.size)
    for one, value, exact in zip(phi.parameters, phi.values, by_parameters, strict=True):
        step = 1e-6 * (one.upper - one.lower)
        high, low = (phi.having({one.name: value + sign * step}) for sign in (1, -1))
        numeric = (high(COS_I, COS_E, PHASE) - low(COS_I, COS_E, PHASE)) / (2 * step)
        np.testing.assert_allclose(exact, numeric, rtol=1e-5, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize("phi", ALL, ids=lambda phi: phi.name)
def test_light_and_view_may_change_places(phi: PhotometricFunction) -> None:
    """Φ/μ0 is symmetric in both (Minnaert 1941)."""
    there, back = phi(COS_I, COS_E, PHASE) / COS_I, phi(COS_E, COS_I, PHASE) / COS_E
    np.testing.assert_allclose(there, back, rtol=1e-12)


def test_limits_of_the_formulas() -> None:
    lunar = 2 * COS_I / (COS_I + COS_E)
    place = COS_I, COS_E, PHASE
    np.testing.assert_allclose(lommel_seeliger(*place), lunar, rtol=1e-15)
    np.testing.assert_allclose(lambert(*place), COS_I, rtol=1e-15)
    for text, expected in (
        ("minnaert k=1", COS_I),
        ("hapke w=0 B0=0 xi=0", lunar),
        ("hapke-rough theta_bar=0", photometric_function("hapke")(*place)),
        ("hapke-two-lobes b=0.4 c=1", photometric_function("hapke xi=-0.4")(*place)),
        ("akimov-phase eta=1 slope=0", photometric_function("akimov")(*place)),
        ("lommel-seeliger-exponential a=0 b=0 c=0", lunar),
        ("lunar-lambert a=0 b=0 c=0", lunar),
    ):
        np.testing.assert_allclose(photometric_function(text)(*place), expected, rtol=1e-12)


def test_the_weight_of_mcewen() -> None:
    degrees = np.array([0.0, 30.0, 60.0, 90.0, 150.0])
    weight = np.array([1.0, 1 - 0.57 + 0.2178 - 0.03942, 0, 1 - 1.71 + 1.9602 - 1.06434, 0.0])
    weight[2] = 1 - 1.14 + 0.8712 - 0.31536
    expected = weight * 2 * 0.8 / 1.4 + (1 - weight) * 0.8
    found = lunar_lambert(np.float64(0.8), np.float64(0.6), np.radians(degrees))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_hapke_by_its_formula() -> None:
    """One direction, written out from Hapke (1981)."""
    w, b_0, h, xi, mu_0, mu, phase = 0.3, 0.8, 0.05, -0.25, 0.7, 0.5, 0.9
    gamma = np.sqrt(1 - w)

    def brightness(mu_0: float, mu: float, phase: float) -> float:
        h_0, h_1 = ((1 + 2 * x) / (1 + 2 * x * gamma) for x in (mu_0, mu))
        lobe = (1 - xi**2) / (1 + 2 * xi * np.cos(phase) + xi**2) ** 1.5
        surge = b_0 / (1 + np.tan(phase / 2) / h)
        return mu_0 / (mu_0 + mu) * ((1 + surge) * lobe + h_0 * h_1 - 1)

    found = photometric_function(f"hapke w={w} B0={b_0} h={h} xi={xi}")
    expected = brightness(mu_0, mu, phase) / brightness(1, 1, 0)
    assert found(*map(np.float64, (mu_0, mu, phase))) == pytest.approx(expected, rel=1e-13)


def test_roughness_darkens_towards_the_terminator() -> None:
    """Hapke (1984): shadows of unresolved slopes; none of them at zero phase from above."""
    cosine = np.cos(np.radians([0.0, 40.0, 80.0]))
    seen = np.ones(3), np.arccos(cosine)
    smooth, rough = (photometric_function(n)(cosine, *seen) for n in ("hapke", "hapke-rough"))
    ratio = rough / smooth
    assert ratio[0] == pytest.approx(1.0, abs=1e-6)
    assert 1.0 > ratio[1] > ratio[2]


@compiled
def sum_by_terms(code: int, packed: np.ndarray, cosines: np.ndarray, phase: float) -> float:
    terms, total = phase_terms(code, packed, phase), 0.0
    for k in range(cosines.size):
        total += shade_at(code, terms, cosines[k], 0.6)[1]
        total -= shade(code, packed, cosines[k], 0.6, phase)[1]
    return total


def test_kernels_choose_a_function_by_its_code() -> None:
    cosines = np.linspace(0.5, 0.7, 20)
    for phi in ALL:
        assert sum_by_terms(int(phi.code), phi.packed, cosines, 0.4) == 0.0


def test_settings_have_a_name_and_parameters() -> None:
    phi = photometric_function("minnaert k=0.7 k_slope=0.001")
    assert photometric_function(phi.text) == phi
    assert phi.text == "minnaert k=0.7 k_slope=0.001"
    for text, message in (
        ("hapky", "'hapky' is none of lunar-lambert"),
        ("", "'' is none of"),
        ("minnaert q=1", "q: is no parameter of the photometric function minnaert"),
        ("minnaert k=7", "k of the photometric function minnaert: must be 0 to 2, not 7"),
        ("minnaert k=nan", "must be 0 to 2, not nan"),
        ("minnaert k", "'k' is not of the form parameter=number"),
    ):
        with pytest.raises(SettingsError, match=message):
            photometric_function(text)
