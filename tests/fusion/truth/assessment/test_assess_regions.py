"""Height errors, slopes and calibration of maplets whose errors are planted."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.truth.assessment import AssessmentSettings
from fusion.truth.assessment.patches import patch_errors
from fusion.truth.assessment.regions import BANDS_DEG, REGIONS, Ground, PointErrors, score_regions
from spcola.errors import SettingsError
from spcola.grids import Maplet, MapletGrid
from spcola.math import Similarity, lattice
from spcola.truth.body import BOULDER, CRATER, SMOOTH

SAME = Similarity(target="spc", source="lidar")
PLANTED = Similarity.from_rotation_vector(
    [2e-4, -1e-4, 3e-4], [0.07, -0.05, 0.04], 1.0 / 1.0005, target="spc", source="lidar"
)


@pytest.fixture
def ground(top) -> Ground:
    """The southern half is dark."""
    return Ground(top, lambda places: (places[:, 2] > 0).astype(float), AssessmentSettings())


def perfect(truth, to_model: Similarity, latitude: float = 30.0) -> Maplet:
    """A maplet of the truth itself, brought to a model's frame point by point."""
    angle = np.radians(latitude)
    direction = np.array([np.cos(angle), 0.0, np.sin(angle)])
    center = truth.radius(direction[None])[0] * direction
    grid = MapletGrid.facing(center, truth.nearest(center[None]).normals[0], 0.5, 20)
    height = truth.heights(grid)
    moved = MapletGrid(
        to_model.apply(grid.center), to_model.turn(grid.axes), to_model.scale * grid.gsd, 20
    )
    return Maplet("P", moved, to_model.scale * height)


def scores(points: PointErrors) -> dict:
    return {region.region: region for region in score_regions(points)}


@pytest.mark.parametrize("to_model", [SAME, PLANTED])
def test_a_perfect_maplet_has_no_error_whatever_is_planted(ground, to_model) -> None:
    found = patch_errors(perfect(ground.truth, to_model), ground, to_model)
    assert found.rms < 1e-9
    assert scores(found.points)["all"].slope_rms_deg < 1e-6


def test_a_maplet_moved_by_10_cm_along_its_normal_scores_10_cm(ground) -> None:
    maplet = perfect(ground.truth, PLANTED)
    raised = maplet.with_layers(height=maplet.height + 0.1)
    whole = scores(patch_errors(raised, ground, PLANTED).points)["all"]
    assert whole.mean == pytest.approx(0.1, abs=1e-6)
    assert whole.rms == pytest.approx(0.1, abs=1e-6)
    assert whole.largest == pytest.approx(0.1, abs=1e-5)
    assert whole.robust == pytest.approx(0.0, abs=1e-6)


def test_a_scaled_maplet_is_too_high_by_its_share_of_the_radius(ground) -> None:
    maplet = perfect(ground.truth, Similarity(scale=1.0005, target="spc", source="lidar"))
    found = scores(patch_errors(maplet, ground, SAME).points)["all"]
    grid = maplet.grid
    assert found.mean == pytest.approx(0.0005 * grid.center @ grid.uz, rel=0.01)


def test_a_tilted_maplet_has_the_slope_error_of_its_tilt(ground) -> None:
    maplet = perfect(ground.truth, SAME)
    tilt = maplet.height + np.tan(np.radians(2.0)) * 0.5 * maplet.grid.offsets[None, :]
    whole = scores(patch_errors(maplet.with_layers(height=tilt), ground, SAME).points)["all"]
    assert whole.slope_rms_deg == pytest.approx(2.0, rel=0.01)


def test_right_sigmas_hold_68_and_95_of_a_hundred(ground) -> None:
    generator, truth = np.random.default_rng(7), perfect(ground.truth, SAME)
    sigma = 0.05 + 0.1 * generator.random(truth.height.shape)
    parts = []
    for _ in range(40):
        noisy = truth.height + sigma * generator.normal(size=sigma.shape)
        parts.append(patch_errors(truth.with_layers(height=noisy, sigma=sigma), ground, SAME))
    points = [part.points for part in parts]
    layers = ("height", "slope", "sigma", "direction", "regions")
    whole = PointErrors(*(np.concatenate([getattr(p, name) for p in points]) for name in layers))
    for region in ("all", "lit", "latitude 30 … 60°"):
        found = scores(whole)[region]
        assert found.within_1 == pytest.approx(0.6827, abs=0.006)
        assert found.within_2 == pytest.approx(0.9545, abs=0.003)
        assert found.pull_std == pytest.approx(1.0, abs=0.01)
        assert found.pull_mean == pytest.approx(0.0, abs=0.015)
        assert found.rms == pytest.approx(found.sigma_rms, rel=0.02)


def test_the_sigma_of_the_centre_counts_along_the_normal(ground) -> None:
    maplet = perfect(ground.truth, SAME).with_layers(
        sigma=np.full((41, 41), 0.03), center_sigma=np.full(3, 0.04)
    )
    sigma = patch_errors(maplet, ground, SAME).points.sigma
    # In the middle, where the grid touches the ground, there is no slope.
    assert sigma.reshape(41, 41)[20, 20] == pytest.approx(0.05, rel=1e-3)
    assert (sigma >= 0.05 - 1e-6).all()


def test_a_maplet_without_sigmas_states_nothing(ground) -> None:
    whole = scores(patch_errors(perfect(ground.truth, SAME), ground, SAME).points)["all"]
    assert np.isnan([whole.within_1, whole.within_2, whole.pull_std, whole.sigma_rms]).all()


def test_gaps_are_no_errors(ground) -> None:
    maplet = perfect(ground.truth, SAME)
    holed = maplet.height.copy()
    holed[:10] = np.nan
    found = patch_errors(maplet.with_layers(height=holed), ground, SAME)
    assert len(found.points.height) == 31 * 41
    assert found.rms < 1e-9
    nothing = patch_errors(maplet.with_layers(height=np.full((41, 41), np.nan)), ground, SAME)
    assert np.isnan(nothing.rms)
    assert all(np.isnan(score.rms) for score in score_regions(nothing.points))


def test_every_place_is_in_its_regions(top) -> None:
    flags = np.array([0, BOULDER, CRATER, BOULDER | CRATER, SMOOTH, SMOOTH | BOULDER], np.uint8)
    top.terrain = lambda places, *, smallest: np.resize(flags, len(places))
    dark = AssessmentSettings().dark_share
    light = np.resize([0.0, dark - 1e-3, dark + 1e-3, 1.0], 6000)
    places = top.points(lattice(6000))
    bits = Ground(top, lambda _: light, AssessmentSettings()).regions(places)
    mask = {name: (bits >> number) & 1 > 0 for number, name in enumerate(REGIONS)}
    assert mask["all"].all()
    assert (mask["lit"] != mask["shadowed"]).all()
    np.testing.assert_array_equal(mask["shadowed"], light < dark)
    np.testing.assert_array_equal(np.flatnonzero(mask["boulders"][:6]), [1, 3, 5])
    np.testing.assert_array_equal(np.flatnonzero(mask["craters"][:6]), [2])
    np.testing.assert_array_equal(np.flatnonzero(mask["smooth site"][:6]), [4, 5])
    np.testing.assert_array_equal(np.flatnonzero(mask["other ground"][:6]), [0])
    assert (np.sum([mask[name] for name in BANDS_DEG], axis=0) == 1).all()
    latitude = np.degrees(np.arcsin(places[:, 2] / np.linalg.norm(places, axis=1)))
    np.testing.assert_array_equal(mask["latitude 60 … 90°"], latitude >= 60.0)


@pytest.mark.parametrize("wrong", [{"patches": 0}, {"smallest": 0.0}, {"dark_share": 1.5}])
def test_settings_out_of_range_are_refused(wrong) -> None:
    with pytest.raises(SettingsError):
        AssessmentSettings(**wrong)
