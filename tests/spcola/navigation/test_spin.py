"""Rotation of a body: agreement with SPICE, and the effect of changing it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import spiceypy
from scipy.spatial.transform import Rotation

from spcola.errors import InvalidValueError
from spcola.navigation import SPICE_LOCK, Spin

BENNU = Spin(85.45218, -60.36780, 140.68800, 2011.14558095)
TIMES = 6.2e8 + np.array([0.0, 1e3, 1.5e4, 8e7])


# The altimetry group's V34 with W2, and the same with a pole that moves.
V34 = Spin(85.45549522840111, -60.36394381230676, 138.8220994, 2011.146011769066, 1.815e-6)
MOVING = replace(V34, pole_ra_rate_deg_per_century=0.3, pole_dec_rate_deg_per_century=-0.2)


def by_spice(spin: Spin, times: np.ndarray) -> np.ndarray:
    """Axes (N, 3, 3) of a body that a PCK with these constants turns."""
    pool = {
        "BODY2999999_POLE_RA": [spin.pole_ra_deg, spin.pole_ra_rate_deg_per_century],
        "BODY2999999_POLE_DEC": [spin.pole_dec_deg, spin.pole_dec_rate_deg_per_century],
        "BODY2999999_PM": [spin.meridian_deg, spin.rate_deg_per_day, spin.quadratic_deg_per_day2],
    }
    with SPICE_LOCK:
        for name, values in pool.items():
            spiceypy.pdpool(name, values)
        try:
            return np.stack([spiceypy.tipbod("J2000", 2999999, et) for et in times])
        finally:
            for name in pool:
                spiceypy.dvpool(name)


@pytest.mark.parametrize("spin", [BENNU, V34, MOVING])
def test_axes_are_those_of_spice(spin: Spin) -> None:
    # 20 years of rotation are 1.5e7 degrees: SPICE itself is good to 1e-9 rad there.
    np.testing.assert_allclose(spin.axes(TIMES), by_spice(spin, TIMES), rtol=0, atol=1e-8)


@pytest.mark.parametrize("spin", [V34, MOVING])
@pytest.mark.parametrize(
    "shift", ["pole_dec_deg", "pole_ra_deg", "meridian_deg", "quadratic_deg_per_day2"]
)
def test_a_correction_moves_returns_as_spice_does(spin: Spin, shift: str) -> None:
    by = 1e-9 if shift.endswith("2") else 0.05
    corrected = replace(spin, **{shift: getattr(spin, shift) + by})
    points = np.random.default_rng(3).normal(size=(len(TIMES), 3))
    points *= 245.0 / np.linalg.norm(points, axis=1, keepdims=True)
    before, after = by_spice(spin, TIMES), by_spice(corrected, TIMES)
    right = np.einsum("nij,nkj,nk->ni", after, before, points)
    moved = spin.moved(points, corrected, TIMES)
    assert np.linalg.norm(right - points, axis=1).max() > 0.05
    np.testing.assert_allclose(moved, right, rtol=0, atol=1e-5)
    # Without W2 the axis about which the pole is corrected stands elsewhere on the ground.
    if shift == "pole_dec_deg":
        plain, other = (replace(s, quadratic_deg_per_day2=0.0) for s in (spin, corrected))
        assert np.abs(plain.moved(points, other, TIMES) - right).max() > 0.05


def test_the_rate_grows_with_the_square() -> None:
    days = TIMES[0] / 86400.0
    per_day = np.degrees(V34.rate(TIMES[0])) * 86400.0
    assert per_day == pytest.approx(2011.146011769066 + 2 * 1.815e-6 * days, rel=1e-12)


def test_a_corrected_meridian_turns_about_the_pole() -> None:
    other = Spin(85.45218, -60.36780, 140.68800 + 0.01, 2011.14558095)
    vectors = BENNU.change_to(other, TIMES)
    # Body-fixed longitudes get smaller as the meridian moves east.
    np.testing.assert_allclose(np.degrees(vectors), [[0, 0, -0.01]] * 4, atol=1e-9)
    point = BENNU.moved(np.array([[250.0, 0.0, 0.0]]), other, TIMES[:1])[0]
    assert np.degrees(np.arctan2(point[1], point[0])) == pytest.approx(-0.01, abs=1e-9)


def test_a_corrected_pole_goes_around_on_the_ground() -> None:
    other = Spin(85.45218, -60.36780 + 0.01, 140.68800, 2011.14558095)
    period = 360.0 / 2011.14558095 * 86400.0
    times = 6.2e8 + period * np.array([0.0, 0.25, 0.5, 1.0])
    vectors = np.degrees(BENNU.change_to(other, times))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 0.01, rtol=1e-9)
    np.testing.assert_allclose(vectors[:, 2], 0.0, atol=1e-8)
    np.testing.assert_allclose(vectors[2], -vectors[0], atol=1e-9)
    np.testing.assert_allclose(vectors[3], vectors[0], atol=1e-9)
    assert abs(vectors[1] @ vectors[0]) < 1e-9


def test_there_and_back_is_nothing() -> None:
    other = Spin(85.5, -60.0, 141.0, 2011.2)
    there, back = BENNU.change_to(other, TIMES), other.change_to(BENNU, TIMES)
    both = Rotation.from_rotvec(back) * Rotation.from_rotvec(there)
    assert np.max(both.magnitude()) < 1e-12


@pytest.mark.parametrize("bad", [(0.0, 91.0, 0.0, 1.0), (np.nan, 0.0, 0.0, 1.0)])
def test_what_is_no_rotation_is_refused(bad: tuple[float, ...]) -> None:
    with pytest.raises(InvalidValueError, match="spin"):
        Spin(*bad)
