"""Explanations of pulls beyond three sigma: exact shares where the cause is planted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from fusion.report.planted import RecoveredParameter
from fusion.truth.causes import chance, explained
from fusion.truth.planted import PlacedCenter, Planted, TrueState
from fusion.truth.presets import MissionSettings
from spcola.math import lattice

SETTINGS = MissionSettings.tiny()
SHIFT = np.array([0.04, -0.02, 0.06])
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass
class Solved:
    """A workspace of which only the states of images are asked."""

    positions: Mapping[str, np.ndarray]

    def image(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(position=self.positions[name])


def mission() -> tuple[Planted, Solved, dict]:
    """Centres and camera positions that are all off by the same vector."""
    to_spc = SETTINGS.to_spc
    ground, space = 40.0 * lattice(24), 3000.0 * lattice(12)
    centers = {
        f"TR{k}": PlacedCenter(
            f"TR{k}", tuple(to_spc.apply(point) + SHIFT), AXES, 1.0, 4, (0.06,) * 3, tuple(point)
        )
        for k, point in enumerate(ground)
    }
    images = {f"P{k}": TrueState(tuple(place), AXES) for k, place in enumerate(space)}
    solved = {f"P{k}": to_spc.apply(place) + SHIFT for k, place in enumerate(space)}
    scale = {"trajectory": "spc", "per_pair": [{"image": name, "used": True} for name in images]}
    return Planted(SETTINGS, {}, {}, centers, images), Solved(solved), scale


def lines(*rows: RecoveredParameter, trajectory: str = "spc") -> list[str]:
    planted, workspace, scale = mission()
    found = explained(rows, planted, workspace, {**scale, "trajectory": trajectory})  # type: ignore[arg-type]
    return [row.explanation for row in found]


@pytest.mark.parametrize(
    ("name", "cause"),
    [("registration translation z", "maplets' centres"), ("centre offset z", "camera positions")],
)
def test_an_error_that_all_share_is_all_of_the_offset(name: str, cause: str) -> None:
    (line,) = lines(RecoveredParameter(name, 0.04, 0.04 + SHIFT[2], 0.015, "m"))
    assert "+0.06 of +0.06 m come from the planted errors of" in line
    assert cause in line
    assert "the rest is within three sigma (+0.0 σ)" in line
    assert "by chance one mission in 16,000 has such a pull among 1 parameters" in line


def test_what_no_planted_error_explains_is_said() -> None:
    """An offset that all share neither turns nor scales anything."""
    turned, biased = lines(
        RecoveredParameter("pole x", 0.0, 0.01, 0.001, "deg"),
        RecoveredParameter("range bias", 0.0, 0.2, 0.03, "m"),
    )
    assert "the rest is unexplained (+10.0 σ)" in turned
    assert biased.startswith("no planted error is known that explains it; by chance one mission in")


def test_with_a_trajectory_of_its_own_the_lidar_does_not_share_errors_of_spc() -> None:
    (line,) = lines(
        RecoveredParameter("centre offset z", 0.0, 0.06, 0.01, "m"), trajectory="reference"
    )
    assert line.startswith("no planted error is known")


def test_small_pulls_need_no_explanation() -> None:
    rows = [
        RecoveredParameter("epsilon", 1e-4, 1.2e-4, 1e-5, ""),
        RecoveredParameter("range bias", 0.0, float("nan"), float("nan"), "m"),
    ]
    assert lines(*rows) == ["", ""]
    assert lines(*rows, replace(rows[0], recovered=2e-4))[:2] == ["", ""]


def test_chance() -> None:
    assert chance(3.0, 1) == pytest.approx(0.0027, rel=1e-3)
    assert chance(-3.0, 20) == pytest.approx(1.0 - (1.0 - 0.0026998) ** 20, rel=1e-4)
    assert chance(0.0, 5) == 1.0
