"""States of images from kernels: planted motion, light time, aberration, gaps; MapCam's kernels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import spiceypy
from scipy.spatial.transform import Rotation

from spcola.errors import KernelError
from spcola.navigation import SPICE_LOCK
from spcola.spice import KernelSet
from spcola.spice.states import Correction, SpiceCamera, body_rate, spice_states

BENNU = 2101955
LIGHT = 299_792_458.0
START, END = 0.0, 1000.0
CRAFT_V, BODY_V = np.array([0.05, -0.02, 0.01]), np.array([-2.0e4, 1.5e4, 5.0e3])
PLACE = np.array([30_000.0, -40_000.0, 10_000.0])
TURN = Rotation.from_rotvec([0.4, -0.3, 2.0]).as_matrix()
FRAME = """KPL/FK
\\begindata
  FRAME_TEST_CAMERA    = -999001
  FRAME_-999001_NAME   = 'TEST_CAMERA'
  FRAME_-999001_CLASS  = 4
  FRAME_-999001_CLASS_ID = -999001
  FRAME_-999001_CENTER = -999
  TKFRAME_-999001_SPEC = 'MATRIX'
  TKFRAME_-999001_RELATIVE = 'J2000'
  TKFRAME_-999001_MATRIX = ( {} )
  BODY2101955_POLE_RA  = ( 85.0 0.0 0.0 )
  BODY2101955_POLE_DEC = ( -60.0 0.0 0.0 )
  BODY2101955_PM       = ( 10.0 2.011146D+03 0.0 )
\\begintext
"""


@pytest.fixture(scope="module")
def kernels(tmp_path_factory) -> KernelSet:
    """A body and the Sun in even motion about the barycentre, and a spacecraft near the body."""
    folder: Path = tmp_path_factory.mktemp("kernels")
    # SPICE's matrix takes the frame to J2000, column by column.
    text = FRAME.format("\n".join(f"{value:.17g}" for value in TURN.ravel()))
    (folder / "frame.tf").write_text(text)
    path = folder / "paths.bsp"
    times = np.array([START, END])
    bodies = [
        (BENNU, 0, np.array([1.5e11, 2e10, 0.0]), BODY_V),
        (-999, BENNU, PLACE, CRAFT_V),
        (10, 0, np.array([5e8, 0.0, 0.0]), np.zeros(3)),
    ]
    with SPICE_LOCK:
        handle = spiceypy.spkopn(str(path), "TEST", 0)
        for target, center, start, velocity in bodies:
            place = start + times[:, None] * velocity
            states = np.concatenate([place, np.tile(velocity, (2, 1))], axis=1) / 1000.0
            spiceypy.spkw09(
                handle, target, center, "J2000", START, END, "S", 1, 2, states, times
            )  # fmt: skip
        spiceypy.spkcls(handle)
    return KernelSet([folder / "frame.tf", path])


def state_of(kernels, correction, **options):
    camera = SpiceCamera("-999", BENNU, "TEST_CAMERA", correction, **options)
    with kernels.load():
        (state,) = spice_states(camera, ["P1"], [500.0])
        turn = spiceypy.tipbod("J2000", BENNU, 500.0)
    return state, turn


def test_the_geometric_state_is_the_planted_one(kernels):
    state, turn = state_of(kernels, Correction.NONE)
    np.testing.assert_allclose(turn.T @ state.position, PLACE + 500.0 * CRAFT_V, atol=1e-4)
    np.testing.assert_allclose(turn.T @ state.velocity, CRAFT_V, atol=1e-9)
    np.testing.assert_allclose(state.axes @ turn, TURN, atol=1e-9)
    toward = np.array([5e8, 0.0, 0.0]) - np.array([1.5e11, 2e10, 0.0]) - 500.0 * BODY_V
    np.testing.assert_allclose(turn.T @ state.sun, toward / np.linalg.norm(toward), atol=1e-9)


def test_light_time_takes_the_body_where_and_as_it_was(kernels):
    state, _ = state_of(kernels, Correction.LIGHT_TIME)
    delay = np.linalg.norm(PLACE) / LIGHT
    with kernels.load():
        turn = spiceypy.tipbod("J2000", BENNU, 500.0 - delay)
    # The body moved by 25 km/s · 0.17 ms since.
    expected = PLACE + 500.0 * CRAFT_V + delay * BODY_V
    np.testing.assert_allclose(turn.T @ state.position, expected, atol=2e-3)


def test_aberration_turns_the_direction_back(kernels):
    # Spacecraft and body move together: with aberration the direction is the geometric one, but for
    # terms of the second order in v/c.
    state, _ = state_of(kernels, Correction.ABERRATION)
    there, _ = state_of(kernels, Correction.NONE)
    one, two = (s.position / np.linalg.norm(s.position) for s in (state, there))
    beta = np.linalg.norm(BODY_V) / LIGHT
    assert np.linalg.norm(one - two) < 2.0 * beta**2 + 1e-7
    light, _ = state_of(kernels, Correction.LIGHT_TIME)
    moved = np.linalg.norm(light.position / np.linalg.norm(light.position) - two)
    assert 0.3 * beta < moved < beta


def test_the_pupil_is_off_the_centre_of_mass(kernels):
    offset = np.array([1.0, -2.0, 0.5])
    state, _ = state_of(kernels, Correction.NONE, pupil_m=offset)
    there, _ = state_of(kernels, Correction.NONE)
    np.testing.assert_allclose(state.axes @ (state.position - there.position), offset, atol=1e-9)


def test_the_rate_of_the_body_is_its_spin(kernels):
    with kernels.load():
        rate = body_rate(BENNU, 500.0)
    np.testing.assert_allclose(rate, [0.0, 0.0, np.radians(2011.146) / 86400.0], atol=1e-15)


def test_kernels_that_do_not_cover_an_exposure_are_named_with_the_gap(kernels):
    camera = SpiceCamera("-999", BENNU, "TEST_CAMERA")
    with kernels.load(), pytest.raises(KernelError, match=r"position ends 234\.500 s earlier"):
        spice_states(camera, ["P1", "P2"], [500.0, END + 234.5])


def test_unknown_names_are_one_line(kernels):
    with kernels.load(), pytest.raises(KernelError, match="SPICE reports"):
        spice_states(SpiceCamera("-999", BENNU, "NO_SUCH_FRAME"), ["P1"], [500.0])


MAPCAM = (
    "naif0012.tls", "pck00010.tpc", "bennu_v16.tpc", "orx_v14.tf", "orx_ocams_v07.ti",
    "orex_ocams_addendum_v10.ti", "orx_sclkscet_00065.tsc",
)  # fmt: skip


@pytest.mark.real_data
def test_mapcam_at_the_time_of_its_label(shared_data):
    folder = shared_data / "bennu" / "kernels_mapcam_20190303"
    kernels = KernelSet([*(folder / name for name in MAPCAM), *sorted(folder.glob("*.x*"))])
    with kernels.load():
        # The label's clock count, and half of its exposure, are the time of its tables.
        start = spiceypy.scs2e(-64, "3/0604882742.23115")
        time = start + 5.285275e-3 / 2.0
        assert time == pytest.approx(604882849.43279, abs=6e-6)
        states = {
            c: spice_states(SpiceCamera("-64", BENNU, "ORX_OCAMS_MAPCAM", c), ["M"], [time])[0]
            for c in Correction
        }
        bounds = spiceypy.getfov(-64361, 4)
        focal, pitch = (
            spiceypy.gdpool(f"INS-64361_{item}", 0, 1)[0] for item in ("FOCAL_LENGTH", "PIXEL_SIZE")
        )
        ifov = spiceypy.gdpool("INS-64361_IFOV", 0, 1)[0]
    state = states[Correction.ABERRATION]
    assert bounds[1] == "ORX_OCAMS_MAPCAM"
    np.testing.assert_array_equal(bounds[2], [0.0, 0.0, 1.0])
    # The kernel's field of view is that of 1024 pixels, and its pixels agree to 0.4 %.
    half = np.degrees(np.arctan(bounds[4][0][0] / bounds[4][0][2]))
    assert abs(half) == pytest.approx(1.985, abs=1e-6)
    assert np.degrees(np.arctan(512 * pitch * 1e-3 / focal)) == pytest.approx(1.985, abs=8e-3)
    assert pitch / focal * 1e3 == pytest.approx(ifov, rel=4e-3)
    # Bennu lies in the field of view, 6.6 km away, in sunlight.
    x, y, z = state.axes @ state.scobj
    assert abs(np.degrees(np.arctan2([x, y], z))).max() < 1.985
    assert np.linalg.norm(state.scobj) == pytest.approx(6593.74, abs=0.01)
    # Spacecraft and asteroid move together: the body moves 0.6 m in the light time, which
    # aberration takes back but for the range.
    light, none = states[Correction.LIGHT_TIME], states[Correction.NONE]
    assert 0.3 < np.linalg.norm(light.scobj - none.scobj) < 1.0
    turned = np.cross(state.scobj, none.scobj) / np.linalg.norm(none.scobj) ** 2
    assert np.linalg.norm(turned) < 2e-7
    assert np.linalg.norm(state.velocity) < 0.1


@pytest.mark.real_data
def test_mapcam_between_its_arcs(shared_data):
    folder = shared_data / "bennu" / "kernels_mapcam_20190303"
    kernels = KernelSet([*(folder / name for name in MAPCAM), *sorted(folder.glob("*.x*"))])
    camera = SpiceCamera("-64", BENNU, "ORX_OCAMS_MAPCAM")
    with (
        kernels.load(),
        pytest.raises(KernelError, match=r"ends 116\.236 s earlier and begins 129\.430 s later"),
    ):
        spice_states(camera, ["M"], [604882600.0])
