"""Kernels of a synthetic mission, read by SPICE: the true states plus the planted errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import spiceypy

from spcola.navigation import SPICE_LOCK, Spin
from spcola.spice import KernelSet, body_fixed_states
from spcola.truth.campaign import CampaignSettings, PassSettings, Station, plan_stations
from spcola.truth.campaign.states import StateSettings, true_state
from spcola.truth.kernels import (
    KernelState,
    MissionClock,
    inertial_sun,
    nominal_states,
    true_spin,
    write_pointing,
    write_positions,
    write_texts,
)
from spcola.truth.kernels.names import BODY, CRAFT, SPACECRAFT

PASSES = PassSettings()
CAMPAIGN = CampaignSettings.of_phases(
    approach=9, preliminary_survey=12, detailed_survey=8, radius=60.0, detector=64
)


@dataclass(frozen=True, eq=False)
class Written:
    folder: Path
    spin: Spin
    nominal: Spin
    stations: list[Station]
    states: list[KernelState]
    clock: MissionClock

    @property
    def times(self) -> np.ndarray:
        return np.array([state.time for state in self.states])

    def kernels(self) -> KernelSet:
        return KernelSet(self.folder / "blind.tm")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("kernels")
    stations = sorted(plan_stations(CAMPAIGN, PASSES), key=lambda station: station.time)
    spin = true_spin((85.0, -60.0), 40.0, PASSES.period, PASSES.epoch)
    nominal = replace(spin, pole_dec_deg=-60.02, meridian_deg=spin.meridian_deg + 0.03)
    truths = [true_state(at, PASSES.sun(at.time), StateSettings()) for at in stations]
    names = ["PolyCam" if at.camera.focal_length_mm > 300 else "MapCam" for at in stations]
    states = nominal_states(
        stations, names, truths, spin,
        pointing_sigma=1e-4, generator=np.random.default_rng(3),
    )  # fmt: skip
    clock = MissionClock(np.floor(stations[0].time) - 1e6)
    cameras = dict(zip(names, (at.camera for at in stations), strict=True))
    tsc, _ = write_texts(folder, cameras, nominal, clock, 60.0)
    sun = inertial_sun(spin, PASSES.sun(PASSES.epoch), PASSES.epoch)
    write_positions(folder / "blind.bsp", states, sun)
    write_pointing(folder / "blind.bc", states, tsc)
    return Written(folder, spin, nominal, stations, states, clock)


def test_positions_are_the_true_ones_and_the_planted_errors(written: Written) -> None:
    with written.kernels().load():
        found, _ = body_fixed_states(SPACECRAFT, BODY, written.times)
        velocity = [
            spiceypy.spkezr(str(SPACECRAFT), t, "J2000", "NONE", str(BODY))[0][3:]
            for t in written.times
        ]
    true = np.array([station.position for station in written.stations])
    errors = np.array([state.position_error for state in written.states])
    inertial = np.einsum("nji,nj->ni", written.spin.axes(written.times), true) + errors
    expected = np.einsum("nij,nj->ni", written.nominal.axes(written.times), inertial)
    assert found == pytest.approx(expected, abs=1e-5)
    stated = np.array([state.velocity for state in written.states])
    assert 1000.0 * np.array(velocity) == pytest.approx(stated, abs=1e-9)


def test_errors_are_within_their_sigma_and_change_smoothly(written: Written) -> None:
    sigma = np.array([station.nominal_sigma for station in written.stations])
    size = np.linalg.norm([state.position_error for state in written.states], axis=1)
    assert (size <= sigma + 1e-9).all()
    assert np.median(size / sigma) > 0.2
    turns = np.array([state.pointing_error for state in written.states])
    assert turns.std() == pytest.approx(1e-4, rel=0.3)
    # Between images of an arc the trajectory is the straight one and a smooth error.
    arcs = np.array([state.arc for state in written.states])
    assert 8 < arcs.max() < 30
    k = int(np.flatnonzero(np.diff(arcs) == 0)[0])
    middle = 0.5 * (written.times[k] + written.times[k + 1])
    with written.kernels().load():
        found, _ = spiceypy.spkpos(str(SPACECRAFT), middle, "J2000", "NONE", str(BODY))
    ends = np.array([written.states[j].position for j in (k, k + 1)])
    assert np.linalg.norm(1000.0 * found - ends.mean(axis=0)) < 0.3 * sigma[k]


def test_pointing_is_the_true_one_turned_by_the_planted_errors(written: Written) -> None:
    with written.kernels().load():
        for state, station in zip(written.states, written.stations, strict=True):
            frame = f"{CRAFT}_{state.camera.upper()}"
            _, axes = body_fixed_states("", BODY, [state.time + 0.3], frame=frame)
            to_body = written.nominal.axes([state.time + 0.3])[0]
            assert axes[0] @ to_body == pytest.approx(state.axes, abs=1e-9)
            truth = true_state(station, PASSES.sun(station.time), StateSettings())
            true = truth.axes @ written.spin.axes([state.time])[0]
            turn = state.axes @ true.T
            seen = 0.5 * np.array(
                [turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]]
            )
            assert seen == pytest.approx(state.pointing_error, abs=1e-7)


def test_the_sun_stands_still_where_the_images_have_it(written: Written) -> None:
    with written.kernels().load():
        for time in written.times[::7]:
            toward, _ = spiceypy.spkpos("SUN", time, "J2000", "NONE", str(BODY))
            body_fixed = written.spin.axes([time])[0] @ toward / np.linalg.norm(toward)
            assert body_fixed == pytest.approx(PASSES.sun(time), abs=1e-7)


def test_clock_frames_and_cameras_are_stated(written: Written) -> None:
    with written.kernels().load(), SPICE_LOCK:
        assert spiceypy.sce2s(SPACECRAFT, written.times[0])[:12] == "1/0001000000"
        assert written.clock.text(written.times[0] + 0.25) == spiceypy.sce2s(
            SPACECRAFT, written.times[0] + 0.25
        )
        assert spiceypy.bodn2c("BLINDBODY") == BODY
        instrument = spiceypy.bodn2c("BLINDCRAFT_POLYCAM")
        shape, frame, boresight, _, corners = spiceypy.getfov(instrument, 4)
        assert (shape, frame) == ("RECTANGLE", "BLINDCRAFT_POLYCAM")
        assert np.array_equal(boresight, [0.0, 0.0, 1.0])
        focal = spiceypy.gdpool(f"INS{instrument}_FOCAL_LENGTH", 0, 1)[0]
        pitch = spiceypy.gdpool(f"INS{instrument}_PIXEL_SIZE", 0, 1)[0]
        center = spiceypy.gdpool(f"INS{instrument}_CCD_CENTER", 0, 2)
        turn = spiceypy.pxform("BLINDCRAFT_POLYCAM", "BLINDCRAFT_SPACECRAFT", 0.0)
    assert focal == 628.9
    assert center == pytest.approx([31.5, 31.5])
    half = 32 * pitch / 1000.0 / focal
    assert np.abs(corners[:, :2] / corners[:, 2:]).max() == pytest.approx(half, rel=1e-9)
    assert turn[2, 2] == pytest.approx(1.0)
    assert np.abs(turn[0, 1]) == pytest.approx(np.sin(np.radians(0.03)), rel=1e-6)


def test_kernels_of_the_same_states_have_the_same_bytes(written: Written, tmp_path: Path) -> None:
    sun = inertial_sun(written.spin, PASSES.sun(PASSES.epoch), PASSES.epoch)
    write_positions(tmp_path / "blind.bsp", written.states, sun)
    write_pointing(tmp_path / "blind.bc", written.states, written.folder / "blind.tsc")
    for name in ("blind.bsp", "blind.bc"):
        assert (tmp_path / name).read_bytes() == (written.folder / name).read_bytes()
