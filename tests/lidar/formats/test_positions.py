"""The spacecraft's path in few knots, or not at all."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.formats.native.positions import fit_flight


def path(time: np.ndarray) -> np.ndarray:
    """A body that turns in four hours under a spacecraft that flies by."""
    angle = 2 * np.pi * time / 15_000.0
    radius = 950.0 + 0.05 * time
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 30.0 - 0.1 * time])


@pytest.mark.parametrize("order", ["rising", "shuffled", "repeated"])
def test_few_knots_meet_all_positions(order: str) -> None:
    rng = np.random.default_rng(1)
    time = 6e8 + np.arange(20_000) * 1e-2
    if order == "shuffled":
        rng.shuffle(time)
    if order == "repeated":
        time = np.repeat(time[::4], 4)
    flight = fit_flight(time, path(time - 6e8), 1e-5)
    assert flight is not None
    assert len(flight.time) < 200
    # Knots are doubles at 6e8 s: 1e-7 s apart, in which it flies 0.04 µm.
    assert np.abs(flight.at(time) - path(time - 6e8)).max() < 1.1e-5


def test_a_rough_path_has_none() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(5000.0)
    assert fit_flight(time, path(time) + rng.normal(size=(5000, 3)) * 1e-3, 1e-5) is None


@pytest.mark.parametrize("where", [0, 3137, 4999])
def test_a_jump_is_not_smoothed_over(where: int) -> None:
    time = np.arange(5000.0)
    jumped = path(time)
    jumped[where] += 0.01
    flight = fit_flight(time, jumped, 1e-5)
    assert flight is None or np.abs(flight.at(time) - jumped).max() <= 1e-5


@pytest.mark.parametrize("unknown", ["time", "position", "few"])
def test_what_is_unknown_or_short_has_none(unknown: str) -> None:
    time = np.arange(20.0 if unknown == "few" else 500.0)
    position = path(time)
    if unknown == "time":
        time[3] = np.nan
    if unknown == "position":
        position[3] = np.nan
    assert fit_flight(time, position, 1e-5) is None
