"""Which planted and recovered values are compared, by the trajectory of the returns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from fusion.report.planted import RecoveredParameter
from fusion.truth.planted import Planted
from fusion.truth.presets import MissionSettings
from fusion.truth.recovery import compare

SETTINGS = MissionSettings.tiny()
BIASED, EXACT = "2019-07-01", "2019-07-02"
PLANTED = Planted(SETTINGS, {}, {BIASED: 6e-6, EXACT: 0.0})


def rows_of(scale: dict[str, Any]) -> dict[str, RecoveredParameter]:
    return {row.name: row for row in compare(PLANTED, {}, scale)}


def scale(trajectory: str) -> dict[str, Any]:
    days = [{"day": day, "epsilon": 2.7e-4, "epsilon_sigma": 1e-5} for day in (BIASED, EXACT)]
    return {
        "trajectory": trajectory,
        "epsilon": 2.5e-4,
        "epsilon_sigma": 1e-5,
        "pole_deg": [0.008, -0.008],
        "pole_sigma_deg": [0.002, 0.002],
        "prime_meridian_deg": 0.012,
        "prime_meridian_sigma_deg": 0.002,
        "per_day": days,
    }


def test_pole_and_prime_meridian_are_the_planted_rotation() -> None:
    rows = rows_of(scale("spc"))
    planted = [rows[name].planted for name in ("pole x", "pole y", "prime meridian")]
    assert tuple(planted) == SETTINGS.rotation_deg
    assert rows["pole x"].pull == pytest.approx(1.0)
    assert rows["pole y"].pull == pytest.approx(0.0)
    assert "pole z" not in rows
    assert "pole z" not in rows_of({})


def test_ranges_that_are_planted_too_long_are_recovered_as_a_positive_bias() -> None:
    lidar = replace(SETTINGS.lidar, range_bias=0.04)
    planted = Planted(replace(SETTINGS, lidar=lidar), {}, {})
    found = {"range_bias_m": 0.05, "range_bias_sigma_m": 0.005}
    rows = {row.name: row for row in compare(planted, {}, found)}
    assert rows["range bias"].pull == pytest.approx(2.0)
    assert rows_of(scale("spc"))["range bias"].planted == 0.0


def test_the_bias_of_a_day_is_a_scale_only_where_the_trajectory_is_that_of_spc() -> None:
    """By another trajectory it moves the surface by bias · range, away from the spacecraft."""
    rows = rows_of(scale("spc"))
    assert rows[f"epsilon of {BIASED}"].planted == pytest.approx(SETTINGS.epsilon + 6e-6)
    assert rows[f"epsilon of {EXACT}"].pull == pytest.approx(2.0)
    rows = rows_of(scale("reference"))
    assert f"epsilon of {BIASED}" not in rows
    assert rows[f"epsilon of {EXACT}"].pull == pytest.approx(2.0)


def test_a_shift_of_the_centre_is_seen_from_another_trajectory_alone() -> None:
    shift = [rows_of(scale("reference"))[f"centre offset {axis}"].planted for axis in "xyz"]
    assert tuple(shift) == pytest.approx([-t for t in SETTINGS.translation_m])
    assert rows_of(scale("spc"))["centre offset x"].planted == 0.0
