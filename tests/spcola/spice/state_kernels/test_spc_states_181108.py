"""SPK and CK that a mission made from SUM files: what they are, and the same made again."""

from __future__ import annotations

import numpy as np
import pytest
import spiceypy
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, SpcImage
from spcola.navigation import SPICE_LOCK, et_from_utcs, utc_from_et
from spcola.spice import KernelSet
from spcola.spice.state_kernels import META_KERNEL, KernelNumbers, write_state_kernels
from spcola.spice.states import spin_of

pytestmark = pytest.mark.real_data
BENNU, CRAFT = 2101955, -64
COUNT = 756
CAMERA = Camera(628.9, [512.5, 512.5], [[117.6, 0, 0], [0, 117.6, 0]], 1024, 1024)


@pytest.fixture(scope="module")
def folder(shared_data):
    return shared_data / "bennu" / "spc_states_181108"


def numbers_of(path, begin, end):
    with SPICE_LOCK:
        handle = spiceypy.dafopr(str(path))
        values = spiceypy.dafgda(handle, begin, end)
        spiceypy.dafcls(handle)
    return values


@pytest.fixture(scope="module")
def states(folder):
    """Times (N,), s, positions (N, 3), m, velocities (N, 3), m/s: records of the SPK, type 9."""
    values = numbers_of(folder / "orx_s_181108_181217_ALTP_v01.bsp", 5761, 11061)
    rows = 1000.0 * values[: 6 * COUNT].reshape(COUNT, 6)
    return values[6 * COUNT : 7 * COUNT], rows[:, :3], rows[:, 3:]


@pytest.fixture(scope="module")
def attitudes(folder):
    """Ticks (N,), and quaternions (N, 4) from J2000: records of the CK, type 3 with rates."""
    values = numbers_of(folder / "orx_s_181108_181217_ALTP_v01.bc", 769, 6826)
    rows = values[: 7 * COUNT].reshape(COUNT, 7)
    return values[7 * COUNT : 8 * COUNT], rows[:, :4]


def test_epochs_are_whole_milliseconds_of_utc(states):
    times, _, _ = states
    assert {utc_from_et(time, 6)[-3:] for time in times} == {"000"}
    assert (np.diff(times) > 600.0).sum() == 19


def test_its_clock_drifts_evenly_from_a_later_clock_kernel(shared_data, states, attitudes):
    # The epochs in the CK are ticks of the clock kernel of January 2019, which is not here.
    ticks, _ = attitudes
    clock = shared_data / "bennu" / "kernels_mapcam_20190303" / "orx_sclkscet_00065.tsc"
    with KernelSet([clock.parent / "naif0012.tls", clock]).load():
        late = states[0] - [spiceypy.sct2e(CRAFT, tick) for tick in ticks]
    line = np.polyfit(states[0] - states[0][0], late, 1)
    assert line[1] == pytest.approx(0.0115, abs=1e-4)
    assert line[0] == pytest.approx(5.31e-8, abs=1e-10)
    assert np.std(late - np.polyval(line, states[0] - states[0][0])) < 1e-7


def test_velocities_are_relative_to_the_rotating_body(folder, states):
    times, places, velocity = states
    near = np.flatnonzero(np.diff(times) < 600.0)
    steps = np.diff(times)[near, None]
    moved = np.diff(places, axis=0)[near] / steps
    middle = (places[near] + places[near + 1]) / 2.0
    rest = moved - (velocity[near] + velocity[near + 1]) / 2.0
    # rest = ω × r, robustly solved for ω: with it the rotation is known by which SUM files were
    # turned to J2000.
    x, y, z = middle.T
    zero = np.zeros_like(x)
    rows = np.stack([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    used = np.ones(len(near), dtype=bool)
    for _ in range(6):
        rate = np.linalg.lstsq(rows[used].reshape(-1, 3), rest[used].ravel(), rcond=None)[0]
        off = np.linalg.norm(rows @ rate - rest, axis=1)
        used = off < 3.0 * np.median(off)
    length = np.linalg.norm(rate)
    found = [
        np.degrees(np.arctan2(rate[1], rate[0])),
        np.degrees(np.arcsin(rate[2] / length)),
        np.degrees(length) * 86400.0,
    ]
    one, other = (
        spin_of(folder / name, BENNU)
        for name in ("bennu_pck_od090.tpc", "bennu_pck_altwg_V34.v2.tpc")
    )
    stated = [one.pole_ra_deg, one.pole_dec_deg, one.rate_deg_per_day]
    assert np.all(np.abs(np.subtract(found, stated)) < [0.002, 0.002, 0.06])
    assert abs(found[0] - other.pole_ra_deg) > 0.15
    # The spacecraft itself is slow: 0.1 m/s.
    still = velocity + np.cross(rate, places)
    assert np.median(np.linalg.norm(velocity, axis=1)) > 20.0
    assert np.median(np.linalg.norm(still, axis=1)) < 0.12


def test_the_spacecraft_looks_at_the_body(states, attitudes):
    axes = Rotation.from_quat(attitudes[1][:, [1, 2, 3, 0]]).as_matrix()
    toward = -states[1] / np.linalg.norm(states[1], axis=1, keepdims=True)
    off = np.degrees(np.arccos(np.einsum("ni,ni->n", axes[:, 2], toward)))
    assert np.median(off) < 0.1
    assert off.max() < 0.9


def test_the_same_kernels_made_again(tmp_path, folder, states, attitudes):
    times, places, _ = states
    spin = spin_of(folder / "bennu_pck_od090.tpc", BENNU)
    turns = spin.axes(times)
    axes = Rotation.from_quat(attitudes[1][:, [1, 2, 3, 0]]).as_matrix()
    images = [
        SpcImage(f"P{k:04d}", utc_from_et(time), CAMERA, -turn @ place, seen @ turn.T, [1, 0, 0])
        for k, (time, turn, place, seen) in enumerate(zip(times, turns, places, axes, strict=True))
    ]
    assert np.abs(et_from_utcs([image.utc for image in images]) - times).max() < 1e-6
    made = write_state_kernels(
        tmp_path / "kernels",
        images,
        KernelNumbers(CRAFT, BENNU, "ORX", "BENNU", -64990),
        spin,
        max_gap_s=600.0,
    )
    assert (made.images, made.segments) == (COUNT, 20)
    with KernelSet(tmp_path / "kernels" / META_KERNEL).load():
        again = [spiceypy.spkpos("ORX", t, "J2000", "NONE", "BENNU")[0] for t in times]
        turned = np.array([spiceypy.pxform("J2000", "ORX_SPC_1", t) for t in times])
    assert np.linalg.norm(1000.0 * np.array(again) - places, axis=1).max() < 1e-3
    apart = Rotation.from_matrix(np.einsum("nij,nkj->nik", turned, axes)).magnitude()
    assert apart.max() < 1e-6
