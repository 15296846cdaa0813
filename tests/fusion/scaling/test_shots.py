from __future__ import annotations

import numpy as np
import pytest

from fusion.scaling.fit import ScaleOptions, estimate_scale
from fusion.scaling.shots import compare_shots
from lidar.formats import read_scan
from lidar.scans import Scan
from spcola.formats.shapes import read_shape
from spcola.shape import Mesh, RayCaster

OCTAHEDRON = Mesh(
    100.0 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]),
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
)


def shots_at(mesh, count=40, *, distance=1000.0, shift=(0.0, 0.0, 0.0), seed=1):
    """Shots whose measured points lie on `mesh` displaced by `shift`."""
    generator = np.random.default_rng(seed)
    away = generator.normal(size=(count, 3))
    spacecraft = distance * away / np.linalg.norm(away, axis=1, keepdims=True)
    aim = 20.0 * generator.normal(size=(count, 3))
    beam = aim - spacecraft
    beam /= np.linalg.norm(beam, axis=1, keepdims=True)
    hits = RayCaster(Mesh(mesh.vertices + np.array(shift), mesh.facets)).cast(spacecraft, beam)
    met = hits.hit
    time = np.linspace(0.0, 3600.0, count)
    return Scan.of_points("S", hits.points[met], time=time[met], spacecraft=spacecraft[met])


def test_a_shape_measured_in_place_leaves_nothing():
    compared = compare_shots(shots_at(OCTAHEDRON), RayCaster(OCTAHEDRON))
    assert compared.missed == 0
    np.testing.assert_allclose(compared.observations.value, 0.0, atol=1e-8)


def test_a_displaced_surface_agrees_with_the_design_matrix():
    shift = np.array([0.01, -0.02, 0.015])
    observations = compare_shots(
        shots_at(OCTAHEDRON, shift=shift), RayCaster(OCTAHEDRON)
    ).observations
    predicted = observations.design()[:, 0, 1:4] @ shift
    np.testing.assert_allclose(observations.value[:, 0], predicted, atol=1e-8)


@pytest.mark.parametrize("epsilon", [1e-3, -1e-3])
def test_the_sign_of_epsilon_is_that_of_the_size_by_either_trajectory(epsilon):
    """A true body that is 1 + ε times SPC's: ranges by SPC's trajectory are longer for ε > 0, by
    an independent one shorter."""
    true = Mesh((1.0 + epsilon) * OCTAHEDRON.vertices, OCTAHEDRON.facets)
    measured, caster = shots_at(true, 200), RayCaster(OCTAHEDRON)
    # Where SPC has the spacecraft all its lengths are too small by 1 + ε; the beams are unchanged.
    by_spc = measured.spacecraft / (1.0 + epsilon)
    points = (
        by_spc
        + np.linalg.norm(measured.points - measured.spacecraft, axis=1)[:, None] * measured.beam
    )
    spc = Scan.of_points("S", points, time=measured.time, spacecraft=by_spc, beam=measured.beam)
    longer = compare_shots(spc, caster, trajectory="spc").observations
    shorter = compare_shots(measured, caster, trajectory="reference").observations
    assert np.all(np.sign(longer.value) == np.sign(epsilon))
    assert np.all(np.sign(shorter.value) == -np.sign(epsilon))
    for observations in (longer, shorter):
        estimate = estimate_scale(observations, options=ScaleOptions(range_bias_prior_m=1e-6))
        assert estimate.epsilon == pytest.approx(epsilon, rel=0.02)


def test_shots_past_the_body_are_counted():
    scan = shots_at(OCTAHEDRON)
    past = Scan.of_points("P", scan.points + 500.0, spacecraft=scan.spacecraft + 500.0)
    assert compare_shots(past, RayCaster(OCTAHEDRON)).missed > 0


@pytest.fixture(scope="module")
def ryugu(shared_data):
    folder = shared_data / "ryugu"
    scan = read_scan(folder / "hyb2_ldr_l2_aocsm_topo_ts_20180701_odd_rows.csv")
    shape = read_shape(folder / "ryugu_sfm_v20180804_decimated.obj", unit="km")
    return scan, RayCaster(shape)


@pytest.mark.real_data
class TestRyugu:
    def test_all_shots_meet_the_shape_within_its_own_coarseness(self, ryugu):
        scan, caster = ryugu
        compared = compare_shots(scan, caster)
        assert compared.missed == 0
        value = compared.observations.value[:, 0]
        # The shape was decimated to facets of some 20 m; the shots lie 2.8 m above it.
        assert value.mean() == pytest.approx(-2.8, abs=0.1)
        assert value.std() < 2.0

    def test_one_day_from_one_side_does_not_determine_the_size(self, ryugu):
        estimate = estimate_scale(compare_shots(*ryugu).observations)
        assert any(line.startswith("epsilon: not determined") for line in estimate.reasons)
        assert abs(estimate.epsilon) < 3 * estimate.epsilon_sigma
        # The shape's own coarseness is found to be the error of a single shot.
        assert 1.0 < estimate.fit.sizes.independent < 3.0
