"""Returns located by SPICE kernels: trajectories, rotations, pointing and mounting by formula."""

from __future__ import annotations

from pathlib import Path

import kernel_files
import numpy as np
import pytest
import spiceypy
from kernel_files import image_times
from scipy.spatial.transform import Rotation

from lidar.geolocation import KernelPlace, MirrorAngles
from spcola.errors import KernelError
from spcola.navigation import Trajectory
from spcola.spice import KernelSet, body_fixed_states, coverage

BENNU = 2101955
CRAFT = "-999"
PCK = """KPL/PCK
\\begindata
  BODY2101955_POLE_RA  = ( {ra} 0.0 0.0 )
  BODY2101955_POLE_DEC = ( -60.0 0.0 0.0 )
  BODY2101955_PM       = ( {w0} 2.011146D+03 0.0 )
\\begintext
"""
SPAN = 600.0
RADIUS = 250.0


def pck(folder: Path, name: str, *, ra: float = 85.0, w0: float = 10.0) -> Path:
    path = folder / name
    path.write_text(PCK.format(ra=ra, w0=w0))
    return path


def spk(path: Path, shift_m: np.ndarray, end: float = SPAN) -> Path:
    """A spacecraft that drifts by 5 cm/s some 700 m from the body, moved by `shift_m`."""
    times = np.linspace(-100.0, end + 100.0, 30)
    place = np.array([500.0, -400.0, 300.0]) + shift_m + times[:, None] * [0.03, 0.04, 0.0]
    states = np.concatenate([place, np.tile([0.03, 0.04, 0.0], (30, 1))], axis=1) / 1000.0
    return kernel_files.spk(path, times, states)


def located(kernels: KernelSet, times: np.ndarray) -> Trajectory:
    with kernels.load():
        return Trajectory("reference", times, body_fixed_states(CRAFT, BENNU, times)[0])


def turns(kernels: KernelSet, times: np.ndarray) -> np.ndarray:
    """From J2000 to the body-fixed frame (N, 3, 3)."""
    with kernels.load():
        return np.array([spiceypy.tipbod("J2000", BENNU, time) for time in times])


@pytest.fixture
def scan() -> tuple[np.ndarray, np.ndarray]:
    """Times and body-fixed points of 400 returns."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(400, 3))
    points *= RADIUS / np.linalg.norm(points, axis=1, keepdims=True)
    return np.sort(rng.uniform(0.0, SPAN, 400)), points


def moved(
    place: KernelPlace, old: KernelSet, scan: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    times, points = scan
    knots = np.linspace(0.0, SPAN, 2000)
    move = place.geolocation(located(old, knots), RADIUS)
    assert move.error_m <= 5e-4
    return move.apply(points, times)


def test_another_trajectory_moves_returns_as_it_moves_the_spacecraft(tmp_path, scan):
    rotation = pck(tmp_path, "a.tpc")
    old = KernelSet([spk(tmp_path / "old.bsp", np.zeros(3)), rotation])
    shift = np.array([3.0, -1.0, 2.0])
    new = KernelSet([spk(tmp_path / "new.bsp", shift), rotation])
    points, known = moved(KernelPlace(new, CRAFT, BENNU), old, scan)
    assert known.all()
    # The shift stands still in the sky: body-fixed it turns.
    right = scan[1] + turns(new, scan[0]) @ shift
    np.testing.assert_allclose(points, right, atol=1e-3)
    assert np.ptp((points - scan[1])[:, 0]) > 0.1


def test_another_rotation_turns_what_points_in_the_sky(tmp_path, scan):
    states = spk(tmp_path / "old.bsp", np.zeros(3))
    old = KernelSet([states, pck(tmp_path, "a.tpc")])
    new = KernelSet([states, pck(tmp_path, "b.tpc", ra=85.02, w0=10.3)])
    place = KernelPlace(new, CRAFT, BENNU, "J2000", old)
    points, known = moved(place, old, scan)
    assert known.all()
    change = turns(new, scan[0]) @ np.swapaxes(turns(old, scan[0]), 1, 2)
    right = np.einsum("nij,nj->ni", change, scan[1])
    assert np.abs(right - scan[1]).max() > 1.0
    np.testing.assert_allclose(points, right, atol=1e-3)


def test_mounting_turns_beams_about_the_pupil_and_shifts_it(tmp_path, scan):
    old = KernelSet([spk(tmp_path / "old.bsp", np.zeros(3)), pck(tmp_path, "a.tpc")])
    boresight, pupil = np.array([1e-3, -2e-3, 5e-4]), np.array([0.4, -0.2, 1.1])
    place = KernelPlace(old, CRAFT, BENNU, "J2000", None, boresight, pupil)
    points, _ = moved(place, old, scan)
    station, turn = located(old, scan[0]).position, turns(old, scan[0])
    beam = np.einsum("nji,nj->ni", turn, scan[1] - station)
    beam = Rotation.from_rotvec(boresight).apply(beam) + pupil
    right = station + np.einsum("nij,nj->ni", turn, beam)
    assert np.abs(right - scan[1]).max() > 1.0
    np.testing.assert_allclose(points, right, atol=1e-3)


def test_angles_of_the_mirror_are_corrected_in_the_frame_of_the_lidar(tmp_path, scan):
    old = KernelSet([spk(tmp_path / "old.bsp", np.zeros(3)), pck(tmp_path, "a.tpc")])
    angles = MirrorAngles((2e-3, -1e-3), (3e-3, 5e-3))
    place = KernelPlace(old, CRAFT, BENNU, "J2000", mirror=angles)
    points, known = moved(place, old, scan)
    assert known.all()
    station, turn = located(old, scan[0]).position, turns(old, scan[0])
    beam = np.einsum("nji,nj->ni", turn, scan[1] - station)
    length = np.linalg.norm(beam, axis=1)
    azimuth, elevation = np.arctan2(beam[:, 0], beam[:, 2]), np.arcsin(beam[:, 1] / length)
    azimuth, elevation = 1.003 * azimuth + 2e-3, 1.005 * elevation - 1e-3
    across = np.cos(elevation)
    unit = np.stack([across * np.sin(azimuth), np.sin(elevation), across * np.cos(azimuth)], 1)
    right = station + np.einsum("nij,nj->ni", turn, length[:, None] * unit)
    assert np.abs(right - scan[1]).max() > 3.0
    np.testing.assert_allclose(points, right, atol=1e-3)
    # Ranges are what was measured, whatever the mirror did.
    np.testing.assert_allclose(np.linalg.norm(points - station, axis=1), length, atol=1e-3)
    reach = place.geolocation(located(old, np.linspace(0.0, SPAN, 2000)), RADIUS).reach(RADIUS)
    assert np.linalg.norm(points - scan[1], axis=1).max() <= reach


def test_a_small_offset_of_the_mirror_is_a_turn_of_the_boresight():
    """Of the azimuth about Y, at the elevation 0 exactly; of the elevation about −X."""
    beams = np.array([[0.0, 0.0, 700.0], [70.0, 0.0, 700.0]])
    turned = MirrorAngles((1e-3, 0.0)).corrected(beams)
    np.testing.assert_allclose(turned, Rotation.from_rotvec([0, 1e-3, 0]).apply(beams), atol=1e-9)
    up = MirrorAngles((0.0, 1e-3)).corrected(beams[:1])
    np.testing.assert_allclose(up, Rotation.from_rotvec([-1e-3, 0, 0]).apply(beams[:1]), atol=1e-9)
    assert np.isnan(MirrorAngles((1e-3, 0.0)).corrected(np.full((1, 3), np.nan))).all()


def test_the_same_kernels_move_nothing(tmp_path, scan):
    old = KernelSet([spk(tmp_path / "old.bsp", np.zeros(3)), pck(tmp_path, "a.tpc")])
    for place in (
        KernelPlace(old, CRAFT, BENNU),
        KernelPlace(old, CRAFT, BENNU, "J2000", old),
    ):
        points, known = moved(place, old, scan)
        assert known.all()
        np.testing.assert_allclose(points, scan[1], atol=1e-4)


def test_there_and_back_is_where_it_began(tmp_path, scan):
    rotation = pck(tmp_path, "a.tpc")
    old = KernelSet([spk(tmp_path / "old.bsp", np.zeros(3)), rotation])
    new = KernelSet([spk(tmp_path / "new.bsp", np.array([3.0, 1.0, 0.0])), rotation])
    there, _ = moved(KernelPlace(new, CRAFT, BENNU), old, scan)
    back, _ = moved(KernelPlace(old, CRAFT, BENNU), new, (scan[0], there))
    np.testing.assert_allclose(back, scan[1], atol=2e-3)


def test_returns_at_times_that_the_kernels_do_not_cover_have_no_place(tmp_path, scan):
    rotation = pck(tmp_path, "a.tpc")
    old = KernelSet([spk(tmp_path / "old.bsp", np.zeros(3)), rotation])
    short = KernelSet([spk(tmp_path / "short.bsp", np.zeros(3), end=200.0), rotation])
    points, known = moved(KernelPlace(short, CRAFT, BENNU), old, scan)
    # It ends at 300 s, which is found to a second.
    assert not known[scan[0] > 300.0].any()
    assert known[scan[0] < 299.0].all()
    assert np.isnan(points[~known]).all()


def test_names_that_the_kernels_do_not_know_are_refused(tmp_path, scan):
    kernels = KernelSet([spk(tmp_path / "old.bsp", np.zeros(3)), pck(tmp_path, "a.tpc")])
    old = located(kernels, np.linspace(0.0, SPAN, 50))
    with pytest.raises(KernelError, match="NOWHERE"):
        KernelPlace(kernels, CRAFT, BENNU, "NOWHERE", kernels).geolocation(old, RADIUS)
    with pytest.raises(KernelError, match="NOBODY"):
        KernelPlace(kernels, "NOBODY", BENNU).geolocation(old, RADIUS)


@pytest.mark.real_data
def test_pointing_of_osiris_rex_by_its_ck(shared_data: Path) -> None:
    """Returns seen by MapCam, real kernels, in two spans with a gap: turned by 1 mrad, and not."""
    folder = shared_data / "bennu" / "kernels_mapcam_20190303"
    kernels = KernelSet(
        sorted(
            path
            for path in folder.iterdir()
            if path.suffix in (".tls", ".tsc", ".tf", ".ti", ".tpc", ".xsp", ".xc")
        )
    )
    frame = "ORX_OCAMS_MAPCAM"
    times = 604_882_240.0 + np.linspace(0.0, 720.0, 721)
    with kernels.load():
        place, axes = body_fixed_states("-64", BENNU, times, frame=frame)
    known = np.isfinite(place).all(axis=1) & np.isfinite(axes).all(axis=(1, 2))
    assert 400 < known.sum() < 600
    time, station, ahead = times[known], place[known], axes[known, 2]
    distance = np.linalg.norm(station, axis=1) - 245.0
    points = station + distance[:, None] * ahead
    old = Trajectory("reference", time, station)
    move = KernelPlace(kernels, "-64", BENNU, frame, kernels).geolocation(old, 300.0)
    moved, inside = move.apply(points, time)
    assert inside.mean() > 0.99
    np.testing.assert_allclose(moved[inside], points[inside], atol=2e-3)
    assert not move.apply(np.zeros((3, 3)), np.array([254.0, 300.0, 480.0]) + times[0])[1].any()
    boresight = np.array([1e-3, 0.0, 0.0])
    turned = KernelPlace(kernels, "-64", BENNU, frame, kernels, boresight).geolocation(old, 300.0)
    aside, inside = turned.apply(points, time)
    angle = np.linalg.norm(aside - points, axis=1) / distance
    assert angle[inside] == pytest.approx(np.full(inside.sum(), 1e-3), rel=0.01)


def states_of_images(shared_data: Path) -> tuple[KernelSet, Path]:
    """Kernels of 756 images over 24 days, made from an SPC solution, and the SPK among them."""
    folder = shared_data / "bennu" / "spc_states_181108"
    others = shared_data / "bennu" / "kernels_mapcam_20190303"
    positions = folder / "orx_s_181108_181217_ALTP_v01.bsp"
    paths = [
        folder / "naif0012.tls", others / "orx_sclkscet_00065.tsc", others / "orx_v14.tf",
        positions, positions.with_suffix(".bc"), folder / "bennu_pck_altwg_V34.v2.tpc",
    ]  # fmt: skip
    return KernelSet(paths), positions


@pytest.mark.real_data
@pytest.mark.parametrize("count", [711, 12_000])
@pytest.mark.parametrize("frame", ["", "ORX_SPACECRAFT"])
def test_the_kernels_that_made_the_shots_move_none(
    shared_data: Path, count: int, frame: str
) -> None:
    """Over 5.8 days, in which the body turns 32 times and images leave gaps of hours."""
    kernels, positions = states_of_images(shared_data)
    end = image_times(positions)[-1]
    rng = np.random.default_rng(7)
    times = np.sort(end - rng.uniform(1.0, 5.8 * 86400.0, count))
    with kernels.load():
        known = coverage("-64", frame=frame, max_gap_s=600.0)
        times = np.append(times, [t for w in known.windows() for t in rng.uniform(*w, 30)])
        times = np.unique(times[times > end - 5.8 * 86400.0])
        old = Trajectory("spc", times, body_fixed_states("-64", BENNU, times)[0])
    points = RADIUS * old.position / np.linalg.norm(old.position, axis=1, keepdims=True)
    reference = kernels if frame else None
    place = KernelPlace(kernels, "-64", BENNU, frame, reference, max_gap_s=600.0)
    move = place.geolocation(old, RADIUS, times)
    moved_, inside = move.apply(points, times)
    np.testing.assert_array_equal(inside, known.covers(times))
    assert inside.any()
    assert not inside.all()
    assert move.error_m <= 5e-4
    assert np.linalg.norm(moved_ - points, axis=1)[inside].max() < 1e-3
    if count == 711:
        assert move.error_m == 0.0


@pytest.mark.real_data
def test_gaps_of_image_kernels_have_no_place(shared_data: Path) -> None:
    """What SPICE interpolates over 68 hours is off by 100 m and more from what was flown."""
    kernels, positions = states_of_images(shared_data)
    times = image_times(positions)
    begin = times[np.argmax(np.diff(times))]
    old = Trajectory("old", [begin, begin + 68 * 3600.0], [[9e3, 0, 0], [0, 9e3, 0]])
    inside_gap = begin + 3600.0 * np.arange(1.0, 67.0)
    asked = np.append(begin, inside_gap)
    moves = [
        KernelPlace(kernels, "-64", BENNU, max_gap_s=gap).geolocation(old, RADIUS, asked)
        for gap in (600.0, 80 * 3600.0)
    ]
    assert not moves[0].covers(inside_gap).any()
    assert moves[0].covers(np.array([begin])).all()
    assert moves[1].covers(inside_gap).all()


@pytest.mark.real_data
def test_the_last_image_of_a_ck_by_a_later_clock(shared_data: Path) -> None:
    """The CK ends 0.12 s before its SPK: the pointing there is the last one, which is stated."""
    kernels, positions = states_of_images(shared_data)
    last = image_times(positions)[-1:]
    frame = "ORX_SPACECRAFT"
    with kernels.load():
        found = [
            body_fixed_states("-64", BENNU, last, frame=frame, tolerance_s=tolerance)[1][0]
            for tolerance in (1e-3, 0.15, 10.0)
        ]
        body = spiceypy.tipbod("J2000", BENNU, last[0])
        rate = Rotation.from_matrix(
            spiceypy.pxform(frame, "J2000", last[0] - 0.2)
            @ spiceypy.pxform(frame, "J2000", last[0] - 1.2).T
        ).magnitude()
        at_end = (body @ spiceypy.pxform(frame, "J2000", last[0] - 0.122513)).T
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(found[1], found[2], atol=1e-9)
    cost = Rotation.from_matrix(found[1] @ at_end.T).magnitude()
    assert cost < 1e-6
    # Between its last two images the spacecraft slews: 0.12 s are 0.16 mrad, 0.8 m from 5 km.
    assert rate == pytest.approx(1.35e-3, rel=0.05)
    for tolerance, known in ((1e-3, False), (0.15, True)):
        place = KernelPlace(
            kernels, "-64", BENNU, frame, kernels, max_gap_s=600.0, tolerance_s=tolerance
        )
        assert place.coverage.covers(last)[0] == known
