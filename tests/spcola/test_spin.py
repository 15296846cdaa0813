"""Rotation of a body: SPICE says the same, and a change is what it is called."""

from __future__ import annotations

import numpy as np
import pytest
import spiceypy
from scipy.spatial.transform import Rotation

from spcola.errors import InvalidValueError
from spcola.spin import Spin, turned

BENNU = Spin(85.45218, -60.36780, 140.68800, 2011.14558095)
TIMES = 6.2e8 + np.array([0.0, 1e3, 1.5e4, 8e7])


def test_axes_are_those_of_spice() -> None:
    pool = {
        "BODY2999999_POLE_RA": [BENNU.pole_ra_deg, 0.0, 0.0],
        "BODY2999999_POLE_DEC": [BENNU.pole_dec_deg, 0.0, 0.0],
        "BODY2999999_PM": [BENNU.meridian_deg, BENNU.rate_deg_per_day, 0.0],
    }
    for name, values in pool.items():
        spiceypy.pdpool(name, values)
    try:
        expected = np.stack([spiceypy.tipbod("J2000", 2999999, et) for et in TIMES])
    finally:
        for name in pool:
            spiceypy.dvpool(name)
    # 20 years of rotation are 1.5e7 degrees: SPICE itself is good to 1e-9 rad there.
    np.testing.assert_allclose(BENNU.axes(TIMES), expected, rtol=0, atol=1e-8)


def test_a_corrected_meridian_turns_about_the_pole() -> None:
    other = Spin(85.45218, -60.36780, 140.68800 + 0.01, 2011.14558095)
    vectors = BENNU.change_to(other, TIMES)
    # Body-fixed longitudes get smaller as the meridian moves east.
    np.testing.assert_allclose(np.degrees(vectors), [[0, 0, -0.01]] * 4, atol=1e-9)
    point = turned(vectors[:1], np.array([[250.0, 0.0, 0.0]]))[0]
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
