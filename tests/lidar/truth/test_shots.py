"""Shots at the synthetic body: rasters, tracks, footprints, noise and losses by formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidar.scans import Scan, join
from lidar.scans.scan import MEASURES
from lidar.truth import (
    LidarSettings,
    ScanErrors,
    TrackSettings,
    scan_chunks,
    scan_name,
)
from lidar.truth.echoes import gaussian_pattern
from spcola.errors import SettingsError
from spcola.truth.body import BodySettings, TruthBody, stream
from spcola.truth.campaign import Pass

EPOCH = 615_211_269.184
AT = Pass(1, EPOCH, 300.0, 15465.6, 0.7, 0.4, 1000.0)
NONE = ScanErrors()
RADIUS = 60.0


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(seed=7, radius=40.0))


@pytest.fixture(scope="module")
def sphere() -> TruthBody:
    return TruthBody(BodySettings.sphere(RADIUS))


def scan_of(body: TruthBody, settings: LidarSettings, *, at: Pass = AT, errors=NONE) -> Scan:
    chunks = scan_chunks(body, at, settings=settings, errors=errors, generator=stream(1, "shots"))
    return join(scan_name(at), list(chunks))


def track_of(body: TruthBody, settings: LidarSettings, tracks: TrackSettings, errors=NONE) -> Scan:
    track = tracks.plan()[0]
    chunks = scan_chunks(
        body, track, settings=settings, errors=errors, generator=stream(1, "track"), chunk=500
    )
    return join(scan_name(track), list(chunks))


def incidence_cosine(scan: Scan) -> np.ndarray:
    """Cosines (N,) of the incidence on the sphere, whatever came back."""
    along = np.sum(scan.spacecraft * scan.beam, axis=1)
    square = RADIUS**2 - np.sum(scan.spacecraft**2, axis=1) + along**2
    return np.sqrt(np.maximum(square, 0.0)) / RADIUS


@pytest.mark.parametrize("chunk", [7, 37, 400, 1000])
def test_a_scan_is_the_same_however_it_is_cut(body: TruthBody, chunk: int) -> None:
    settings = LidarSettings(width=60.0, spacing=3.0, subrays=3)
    whole = scan_of(body, settings)
    chunks = list(
        scan_chunks(
            body, AT, settings=settings, errors=NONE, generator=stream(1, "shots"), chunk=chunk
        )
    )
    assert [len(c) for c in chunks[:-1]] == [chunk] * (len(chunks) - 1)
    parts = join("scan01", chunks)
    for layer in MEASURES:
        np.testing.assert_array_equal(getattr(parts, layer), getattr(whole, layer))


def test_a_raster_covers_its_width_at_its_spacing_to_and_fro(sphere: TruthBody) -> None:
    settings = LidarSettings.exact(20.0, 0.5)
    scan = scan_of(sphere, settings)
    assert settings.lines == 40
    toward = AT.position(np.array([AT.middle]))[0] / AT.distance
    east = np.cross([0.0, 0.0, 1.0], toward)
    east /= np.linalg.norm(east)
    north = np.cross(toward, east)
    # The raster lies on the plane that touches the sphere: beams go through that.
    reach = (RADIUS - scan.spacecraft @ toward) / (scan.beam @ toward)
    aim = scan.spacecraft + reach[:, None] * scan.beam
    u, v = aim @ east, aim @ north
    cells = np.floor(np.stack([u, v], axis=1) / 0.5 + 20.0).astype(int)
    assert sorted(map(tuple, cells)) == [(i, j) for i in range(40) for j in range(40)]
    lines = cells.reshape(40, 40, 2)
    np.testing.assert_array_equal(lines[:, :, 1], np.arange(40)[:, None] * np.ones(40, dtype=int))
    np.testing.assert_array_equal(lines[0, :, 0], np.arange(40))
    np.testing.assert_array_equal(lines[1, :, 0], np.arange(40)[::-1])
    assert np.all(np.diff(scan.time) > 0)
    assert AT.start < scan.time[0] < scan.time[-1] < AT.start + AT.duration


@pytest.mark.parametrize("latitude", [90.0, 89.999, 60.0, -12.0, -90.0])
def test_points_without_errors_lie_on_the_surface(body: TruthBody, latitude: float) -> None:
    at = replace(AT, latitude=np.radians(latitude))
    scan = scan_of(body, LidarSettings.exact(30.0, 0.75), at=at)
    hit = scan.flag % 100 == 0
    assert hit.all()
    error = np.linalg.norm(scan.points, axis=1) - body.radius(scan.points)
    assert np.max(np.abs(error)) < 1e-9
    middle = scan.points.mean(axis=0)
    assert np.degrees(np.arcsin(middle[2] / np.linalg.norm(middle))) == pytest.approx(
        latitude, abs=2.0
    )


def test_noise_grows_with_the_footprint_on_slopes(sphere: TruthBody) -> None:
    settings = LidarSettings(
        width=112.0, spacing=0.4, divergence=4e-4, slope_noise=0.7,
        stray_share=0.0, dropout_share=0.0, grazing_deg=89.0,
    )  # fmt: skip
    scan = scan_of(sphere, settings)
    exact = scan_of(sphere, LidarSettings.exact(112.0, 0.4))
    cosine = incidence_cosine(exact)
    distance = np.linalg.norm(exact.points - exact.spacecraft, axis=1)
    tangent = np.sqrt(1.0 - cosine**2) / np.maximum(cosine, 1e-9)
    sigma = np.hypot(0.03, 0.7 * 1e-4 * distance * tangent)
    error = scan.range - exact.range
    for low, high in ((0, 15), (40, 45), (58, 62), (68, 72)):
        there = (cosine < np.cos(np.radians(low))) & (cosine > np.cos(np.radians(high)))
        there &= (scan.flag % 100 == 0) & (exact.flag % 100 == 0)
        assert there.sum() > 1000
        pull = error[there] / sigma[there]
        assert np.std(pull) == pytest.approx(1.0, rel=0.05)
        assert abs(np.mean(pull)) < 0.06


def test_echoes_are_lost_where_the_ground_is_steep(sphere: TruthBody) -> None:
    settings = LidarSettings(width=116.0, spacing=0.4, dropout_share=0.02)
    scan = scan_of(sphere, settings)
    cosine = incidence_cosine(scan_of(sphere, LidarSettings.exact(116.0, 0.4)))
    lost = scan.flag % 100 == 2
    edge = 0.5
    fall = np.clip(1.0 - cosine / edge, 0.0, 1.0)
    steep = fall**2 * (3.0 - 2.0 * fall)
    expected = 0.02 + (1.0 - 0.02 - 0.005 - 0.001) * steep
    for low, high in ((0.0, 0.01), (0.1, 0.2), (0.2, 0.3), (0.4, 0.5), (0.5, 0.7), (0.7, 1.0)):
        there = (cosine > low) & (cosine <= high)
        share = float(np.mean(expected[there]))
        spread = np.sqrt(share * (1 - share) / there.sum())
        assert np.mean(lost[there]) == pytest.approx(share, abs=4 * spread + 1e-3)


def test_a_beam_past_the_body_has_no_echo(sphere: TruthBody) -> None:
    scan = scan_of(sphere, LidarSettings.exact(200.0, 4.0))
    missed = incidence_cosine(scan) == 0.0
    assert 0.5 < missed.mean() < 0.9
    np.testing.assert_array_equal(scan.flag % 100 == 2, missed)
    assert np.all(scan.intensity[missed] == 0)


def test_subrays_average_over_the_footprint(sphere: TruthBody) -> None:
    one = LidarSettings.exact(4.0, 0.2)
    settings = replace(one, subrays=64, divergence=2e-3)
    single, mean = scan_of(sphere, one), scan_of(sphere, settings)
    # A Gaussian footprint of σ on a sphere of R, met at its middle: the ground falls away by
    # d²/2R, twice σ² on the mean, and the slanting rays are longer by d²/2L.
    sigma = 2e-3 / 4.0 * (AT.distance - RADIUS)
    expected = sigma**2 * (1.0 / RADIUS + 1.0 / (AT.distance - RADIUS))
    np.testing.assert_allclose(mean.range - single.range, expected, rtol=0.1)


def test_a_footprint_over_the_limb_is_an_echo_or_none_and_never_half_known(
    sphere: TruthBody,
) -> None:
    settings = replace(
        LidarSettings.exact(130.0, 2.0), subrays=16, divergence=2e-2, overflow_share=0.5
    )
    scan = scan_of(sphere, settings)
    echo = scan.flag % 100 < 2
    assert 0.3 < echo.mean() < 0.7
    assert np.isfinite(scan.range).all()
    assert np.isfinite(scan.intensity).all()
    single = scan_of(sphere, replace(settings, subrays=1))
    assert not echo[single.flag % 100 == 2].any()


def test_the_pattern_of_a_footprint_has_unit_variance() -> None:
    pattern = gaussian_pattern(200)
    np.testing.assert_allclose(pattern.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cov(pattern.T, bias=True), np.eye(2), atol=0.05)


def test_strength_goes_with_albedo_incidence_and_distance(sphere: TruthBody) -> None:
    near = scan_of(sphere, LidarSettings.exact(60.0, 2.0))
    far = scan_of(sphere, LidarSettings.exact(60.0, 2.0), at=replace(AT, distance=2000.0))
    assert near.intensity.max() / far.intensity.max() == pytest.approx((1940 / 940) ** 2, rel=1e-3)
    cosine = incidence_cosine(near)
    distance = np.linalg.norm(near.points - near.spacecraft, axis=1)
    np.testing.assert_allclose(
        near.intensity, 2000.0 * (0.65 + 0.35 * cosine) * (1000.0 / distance) ** 2, rtol=1e-9
    )
    noisy = (
        scan_of(sphere, replace(LidarSettings.exact(60.0, 0.5), intensity_noise=0.05)).intensity
        / scan_of(sphere, LidarSettings.exact(60.0, 0.5)).intensity
    )
    assert np.std(noisy) == pytest.approx(0.05, rel=0.03)


def test_biases_of_range_add_up(sphere: TruthBody) -> None:
    settings = replace(LidarSettings.exact(20.0, 2.0), range_bias=0.04)
    errors = ScanErrors.drawn(settings, stream(1, "errors"), range_scale=1e-4)
    assert (errors.range_scale, errors.range_bias_m) == (1e-4, 0.04)
    biased = scan_of(sphere, settings, errors=ScanErrors(range_scale=1e-4, range_bias_m=0.05))
    plain = scan_of(sphere, settings)
    true = plain.range + 1.1
    np.testing.assert_allclose(biased.range - plain.range, 1e-4 * true + 0.05, rtol=0, atol=1e-9)
    np.testing.assert_allclose(biased.reference_offset, 1.1, rtol=0, atol=1e-9)
    along = np.sum((biased.points - plain.points) * plain.beam, axis=1)
    np.testing.assert_allclose(along, 1e-4 * true + 0.05, rtol=0, atol=1e-9)


def test_odd_passes_have_the_demodulator_on(sphere: TruthBody) -> None:
    settings = LidarSettings(width=20.0, spacing=0.5)
    odd, even = scan_of(sphere, settings), scan_of(sphere, settings, at=replace(AT, number=2))
    np.testing.assert_array_equal(odd.flag, even.flag + 100)
    off = scan_of(sphere, replace(settings, demodulator=False))
    np.testing.assert_array_equal(off.flag, even.flag)


def test_a_track_keeps_its_orbit(sphere: TruthBody) -> None:
    tracks = TrackSettings(inclination_deg=70.0, rate=0.1, duration=22 * 3600.0)
    first, second = tracks.plan()[:2]
    time = first.start + np.linspace(0.0, tracks.orbit_period, 2001)
    place = first.position(time)
    np.testing.assert_allclose(np.linalg.norm(place, axis=1), 1000.0, rtol=1e-12)
    assert place[:, 2].max() == pytest.approx(1000.0 * np.sin(np.radians(70.0)), rel=1e-5)
    # In space (the body's turning taken out) the orbit closes, and goes on where it ended.
    turned = 2.0 * np.pi * (time - first.start) / first.period
    x = place[:, 0] * np.cos(turned) - place[:, 1] * np.sin(turned)
    assert x[0] == pytest.approx(x[-1], abs=1e-6)
    end = np.array([first.start + first.duration])
    np.testing.assert_allclose(second.position(end), first.position(end), rtol=0, atol=1e-6)


def test_nadir_shots_lie_on_the_surface_below(body: TruthBody) -> None:
    scan = track_of(body, LidarSettings.exact(1.0, 0.1), TrackSettings(rate=0.1))
    assert len(scan) == 2160
    error = np.linalg.norm(scan.points, axis=1) - body.radius(scan.points)
    assert np.max(np.abs(error)) < 1e-9
    np.testing.assert_allclose(np.cross(scan.points, scan.spacecraft), 0.0, atol=1e-6)
    latitude = np.degrees(np.arcsin(scan.points[:, 2] / np.linalg.norm(scan.points, axis=1)))
    assert latitude.min() == pytest.approx(-85.0, abs=0.01)
    assert latitude.max() > 5.0
    np.testing.assert_allclose(scan.reference_offset, 1.1, rtol=0, atol=1e-9)


def test_pointing_errors_of_a_track_are_along_and_across_it(sphere: TruthBody) -> None:
    settings, tracks = LidarSettings.exact(1.0, 0.1), TrackSettings(rate=0.05)
    plain = track_of(sphere, settings, tracks)
    ahead = track_of(sphere, settings, tracks, ScanErrors(pointing_m=(0.5, 0.0)))
    aside = track_of(sphere, settings, tracks, ScanErrors(pointing_m=(0.0, 0.5)))
    step = np.gradient(plain.points, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    inner = slice(1, -1)
    moved = (ahead.points - plain.points)[inner]
    np.testing.assert_allclose(np.sum(moved * step[inner], axis=1), 0.5, rtol=2e-3)
    moved = (aside.points - plain.points)[inner]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 0.5, rtol=2e-3)
    assert np.max(np.abs(np.sum(moved * step[inner], axis=1))) < 2e-3


def test_settings_out_of_range_are_refused() -> None:
    wrong: list[dict[str, float]] = [
        {"spacing": 0.0}, {"width": 0.1, "spacing": 0.07}, {"range_sigma": np.nan},
        {"slope_noise": -0.1}, {"dropout_share": 0.6, "missing_share": 0.5},
        {"overflow_share": -0.1}, {"subrays": 0}, {"divergence": 1.0}, {"grazing_deg": 90.0},
        {"stray_reach": -1.0},
    ]  # fmt: skip
    for values in wrong:
        with pytest.raises(SettingsError):
            LidarSettings(**values)  # type: ignore[arg-type]
    for values in ({"count": 0}, {"distance": 0.0}, {"rate": 1e-6}, {"orbit_period": np.inf}):
        with pytest.raises(SettingsError):
            TrackSettings(**values)  # type: ignore[arg-type]
