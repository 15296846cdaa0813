"""Scans of the synthetic body: on the surface without errors, and wrong as stated with them."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.formats import read_scan
from lidar.formats.missions import write_ola
from lidar.scans import join
from lidar.truth import LidarSettings, ScanErrors, scan_chunks
from spcola.errors import SettingsError
from spcola.math import Similarity
from spcola.truth.body import BodySettings, TruthBody, stream
from spcola.truth.campaign import Pass, PassSettings, plan_passes

QUIET = LidarSettings.exact(48.0, 1.2)
AT = Pass(1, 615_211_269.184, 300.0, 15465.6, 0.7, 0.4, 3500.0)


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(seed=7, radius=40.0))


def _scan(body, settings=QUIET, errors=ScanErrors(), seed=1):  # noqa: B008
    chunks = scan_chunks(
        body, AT, settings=settings, errors=errors, generator=stream(seed, "shots")
    )
    return join("scan", list(chunks))


def test_points_without_errors_lie_on_the_surface(body: TruthBody) -> None:
    scan = _scan(body)
    points = scan.points[scan.flag % 100 == 0]
    assert len(points) == 1600
    error = np.linalg.norm(points, axis=1) - body.radius(points)
    assert np.max(np.abs(error)) < 1e-6


def test_the_range_is_short_by_the_reference_offset(body: TruthBody) -> None:
    np.testing.assert_allclose(_scan(body).reference_offset, 1.1, rtol=0, atol=1e-9)


def test_the_spacecraft_turns_backwards_around_the_body() -> None:
    times = AT.start + np.array([0.0, 150.0, 300.0])
    longitudes = np.unwrap(np.arctan2(*AT.position(times)[:, 1::-1].T))
    np.testing.assert_allclose(np.diff(longitudes), -2 * np.pi * 150.0 / AT.period, rtol=1e-9)
    step = AT.position(times + 0.5) - AT.position(times - 0.5)
    np.testing.assert_allclose(AT.velocity(times), step, rtol=0, atol=1e-6)


def test_a_trajectory_error_moves_all_points_alike(body: TruthBody) -> None:
    moved = _scan(body, errors=ScanErrors(offset_m=(0.1, -0.2, 0.3)))
    np.testing.assert_allclose(
        moved.points - _scan(body).points, np.tile([0.1, -0.2, 0.3], (1600, 1)), atol=1e-9
    )


def test_a_pointing_error_moves_points_across_the_beam(body: TruthBody) -> None:
    moved = _scan(body, errors=ScanErrors(pointing_m=(0.05, 0.0)))
    shift = moved.points - _scan(body).points
    np.testing.assert_allclose(np.linalg.norm(shift, axis=1), 0.05, rtol=0.03)
    assert np.max(np.abs(np.sum(shift * moved.beam, axis=1))) < 2e-3


def test_noise_outliers_and_lost_shots_come_as_often_as_stated() -> None:
    # On a sphere seen at its middle no shot goes in at a steep angle.
    body = TruthBody(BodySettings.sphere(60.0))
    settings = LidarSettings(width=40.0, spacing=0.2, slope_noise=0.0, overflow_share=0.02)
    scan, exact = _scan(body, settings), _scan(body, LidarSettings.exact(40.0, 0.2))
    flag = scan.flag % 100
    assert np.mean(flag == 2) == pytest.approx(0.01, abs=0.0015)
    assert np.mean(flag == 1) == pytest.approx(0.02, abs=0.002)
    assert np.mean(flag == 3) == pytest.approx(0.0005, abs=0.0003)
    lost = (flag == 2) | (flag == 3)
    np.testing.assert_allclose(scan.range[lost], -1.12892)
    assert np.max(np.linalg.norm(scan.points - scan.spacecraft, axis=1)[lost]) < 0.1
    assert np.all((scan.intensity == 0) == lost)
    error = (scan.range - exact.range)[~lost]
    outliers = np.abs(error) > 0.2
    assert np.mean(outliers) == pytest.approx(0.005, abs=0.0015)
    assert np.max(np.abs(error)) < 30.2
    assert np.std(error[~outliers]) == pytest.approx(0.03, rel=0.02)


def test_the_table_reads_back_without_its_rejects(body: TruthBody, tmp_path) -> None:
    settings = LidarSettings(width=88.0, spacing=88.0 / 50, overflow_share=0.02)
    scan = _scan(body, settings)
    write_ola(tmp_path / "scan01.dat", [scan])
    back = read_scan(tmp_path / "scan01.dat")
    flag = scan.flag % 100
    good = flag == 0
    assert 0 < good.sum() < 2500
    names = {1: "overflow", 2: "no return", 3: "missing"}
    counts = {name: np.sum(flag == value) for value, name in names.items()}
    assert dict(back.rejected) == {name: count for name, count in counts.items() if count}
    np.testing.assert_array_equal(back.points, scan.points[good])
    np.testing.assert_array_equal(back.spacecraft, scan.spacecraft[good])


def test_with_spc_states_a_return_is_off_by_epsilon_times_the_range(body: TruthBody) -> None:
    # The measured range is (1 + ε) times the one that the solution predicts.
    epsilon = 2.5e-4
    to_spc = Similarity.from_rotation_vector(
        [1e-4, -2e-4, 3e-4], [0.07, -0.05, 0.04], 1.0 / (1.0 + epsilon)
    )
    scan = _scan(body)
    measured = scan.range + scan.reference_offset
    position, beam = to_spc.apply(scan.spacecraft), to_spc.turn(scan.beam)
    predicted = np.linalg.norm(to_spc.apply(scan.points) - position, axis=1)
    np.testing.assert_allclose(measured - predicted, epsilon * predicted, rtol=1e-7)
    off = position + measured[:, None] * beam - to_spc.apply(scan.points)
    np.testing.assert_allclose(off, epsilon * predicted[:, None] * beam, atol=1e-7)


def test_the_error_levels_are_those_stated() -> None:
    errors = [ScanErrors.drawn(LidarSettings(), stream(k, "errors")) for k in range(400)]
    assert np.std([e.offset_m for e in errors]) == pytest.approx(0.05, rel=0.1)
    assert np.std([e.pointing_m for e in errors]) == pytest.approx(0.05, rel=0.1)


def test_passes_keep_their_local_time_and_their_order() -> None:
    settings = PassSettings()
    passes = plan_passes(settings, stream(1, "passes"))
    assert [at.number for at in passes] == list(range(1, 21))
    starts = np.array([at.start for at in passes])
    assert np.all(np.diff(starts) >= settings.duration)
    assert len({(at.start - settings.epoch) // 86400.0 for at in passes}) == 5
    hours = [
        12 + np.degrees(at.longitude - settings.sun_longitude(at.middle)) / 15.0 for at in passes
    ]
    assert set(np.round(np.mod(hours, 24.0), 6)) == set(settings.local_times_h)
    latitudes = np.degrees([at.latitude for at in passes])
    assert latitudes.min() < -60
    assert latitudes.max() > 60
    assert np.median(np.abs(latitudes)) < 45


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"width": 0.1}, {"range_sigma": -1.0}, {"stray_share": 1.5}):
        with pytest.raises(SettingsError):
            LidarSettings(**wrong)
    with pytest.raises(SettingsError):
        PassSettings(count=1)
