from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from fusion.estimation.verdict import Code, Severity, Verdict
from fusion.scaling.fit import ScaleOptions
from fusion.scaling.geometry import LidarPlacement
from fusion.scaling.judging import (
    expected_scatter,
    lost_findings,
    place_findings,
    scale_findings,
    scan_findings,
)
from fusion.scaling.judging.findings import CROSSING, TOO_LARGE
from fusion.scaling.misplacement import check_place, check_scans, compare_crossings
from fusion.scaling.misplacement.significance import FEWEST_SHOTS, chance_of_larger, independent
from fusion.scaling.shots import compare_shots, iterate_shots
from lidar.formats.reader import read_scan
from lidar.scans import Scan, join
from spcola.errors import NotObservableError
from spcola.formats.shapes import read_shape
from spcola.shape import Mesh, RayCaster

RADIUS, NOISE = 100.0, 0.1


def wrong_shots():
    """The module of ways in which shots are wrong, as the bench has it."""
    path = Path(__file__).parents[3] / "scripts" / "bench" / "wrong" / "shots.py"
    spec = importlib.util.spec_from_file_location("wrong_shots", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


WRONG = wrong_shots()


def body(seed, *, relief=2.0, terms=60, steps=40):
    """A globe of 100 m with waves of some 30 m in all directions, `relief` metres in rms."""
    generator = np.random.default_rng(seed)
    height = np.linspace(-1.0, 1.0, steps + 1)[1:-1]
    around = np.arange(2 * steps) * np.pi / steps
    ring = np.sqrt(1.0 - height**2)
    toward = np.stack(
        [
            np.outer(ring, np.cos(around)),
            np.outer(ring, np.sin(around)),
            np.repeat(height[:, None], 2 * steps, axis=1),
        ],
        axis=2,
    ).reshape(-1, 3)
    toward = np.vstack([toward, [[0, 0, -1.0], [0, 0, 1.0]]])
    wave = generator.normal(size=(terms, 3)) * 12.0
    bumps = np.cos(toward @ wave.T + generator.uniform(0, 2 * np.pi, terms)).sum(axis=1)
    radius = RADIUS + relief * bumps * np.sqrt(2.0 / terms)
    rows, columns = np.meshgrid(np.arange(steps - 2), np.arange(2 * steps), indexing="ij")
    a = (rows * 2 * steps + columns).ravel()
    b = (rows * 2 * steps + (columns + 1) % (2 * steps)).ravel()
    quads = np.concatenate(
        [np.stack([a, b, b + 2 * steps], 1), np.stack([a, b + 2 * steps, a + 2 * steps], 1)]
    )
    low = np.arange(2 * steps)
    top = low + (steps - 2) * 2 * steps
    south = np.stack([np.roll(low, -1), low, np.full(2 * steps, len(toward) - 2)], axis=1)
    north = np.stack([top, np.roll(top, -1), np.full(2 * steps, len(toward) - 1)], axis=1)
    return Mesh(radius[:, None] * toward, np.vstack([quads, south, north]))


def shots_on(mesh, seed, *, count=80, noise=NOISE):
    """Shots from 1 km all around the body, with noise."""
    generator = np.random.default_rng([seed, 1])
    away = generator.normal(size=(count, 3))
    spacecraft = 1000.0 * away / np.linalg.norm(away, axis=1, keepdims=True)
    beam = 30.0 * generator.normal(size=(count, 3)) - spacecraft
    beam /= np.linalg.norm(beam, axis=1, keepdims=True)
    hits = RayCaster(mesh).cast(spacecraft, beam)
    met = hits.hit
    far = hits.distance[met] + noise * generator.normal(size=int(met.sum()))
    points = spacecraft[met] + far[:, None] * beam[met]
    return Scan.of_points(
        "S", points, time=np.arange(float(met.sum())), spacecraft=spacecraft[met], beam=beam[met]
    )


def verdict_of(scan, caster, options=None):
    """What the stage finds of shots, without its files."""
    options = options or ScaleOptions()

    def at(known):
        return compare_shots(scan, caster, known=known)

    compared = at(LidarPlacement())
    if len(compared.observations) < 2:
        return None
    try:
        compared, estimate = iterate_shots(compared, at, options=options)
    except NotObservableError:
        return None
    known = LidarPlacement.of(estimate.fit.estimate)
    check = check_place(scan, caster, prior=options.prior, known=known)
    findings = scale_findings(compared.observations, estimate, options)
    findings += lost_findings("shots", compared.missed, len(scan))
    findings += place_findings(check, expected_scatter(compared.observations, options))
    return Verdict(tuple(findings))


QUICK = ("longitude -10 deg", "latitude +5 deg", "sign of longitude", "ranges exchanged")
NAMES = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.slow)
    for name in WRONG.alterations()
]


@pytest.fixture(scope="module")
def mission():
    mesh = body(1)
    return RayCaster(mesh), shots_on(mesh, 1)


@pytest.fixture(scope="module")
def ryugu(shared_data):
    folder = shared_data / "ryugu"
    scan = read_scan(folder / "hyb2_ldr_l2_aocsm_topo_ts_20180701_odd_rows.csv")
    return scan, RayCaster(read_shape(folder / "ryugu_sfm_v20180804_decimated.obj", unit="km"))


class TestPlantedTruth:
    """Right shots are accepted, and whatever is wrong with them is not."""

    @pytest.mark.parametrize("seed", [1, 2])
    def test_right_shots_are_accepted(self, seed):
        mesh = body(seed)
        assert verdict_of(shots_on(mesh, seed), RayCaster(mesh)).judgement == "accepted"

    @pytest.mark.parametrize("name", NAMES)
    def test_wrong_shots_are_not(self, mission, name):
        caster, scan = mission
        verdict = verdict_of(WRONG.altered(scan, name), caster)
        assert verdict is None or verdict.judgement != "accepted"

    def test_shots_of_another_body_are_not(self, mission):
        verdict = verdict_of(shots_on(body(2), 2), mission[0])
        assert verdict is None or verdict.judgement != "accepted"

    @pytest.mark.parametrize("turn", [-50.0, 10.0])
    def test_a_turn_is_named(self, mission, turn):
        caster, scan = mission
        matrix = Rotation.from_rotvec([0.0, 0.0, np.radians(turn)]).as_matrix()
        wrong = WRONG.moved(scan, scan.points @ matrix.T, scan.spacecraft @ matrix.T)
        check = check_place(wrong, caster, prior=ScaleOptions().prior)
        assert check.misfit
        assert check.best.about_z
        assert abs(check.best.signed_deg + turn) <= 1.0
        assert f"turned by {check.best.signed_deg:+.1f} deg about Z" in str(check.best)

    def test_a_mirrored_longitude_is_named(self, mission):
        caster, scan = mission
        check = check_place(
            WRONG.altered(scan, "sign of longitude"), caster, prior=ScaleOptions().prior
        )
        assert check.misfit
        assert str(check.best) == "mirrored (longitude of the other sign)"


@pytest.fixture(scope="module")
def scans():
    """Four scans of one body, and the caster of its surface."""
    mesh = body(1)
    return RayCaster(mesh), [shots_on(mesh, seed, count=80) for seed in range(1, 5)]


def turned(scan, seed, turn=5.0):
    """A scan turned about an axis of its own."""
    axis = np.random.default_rng([seed, 9]).normal(size=3)
    matrix = Rotation.from_rotvec(np.radians(turn) * axis / np.linalg.norm(axis)).as_matrix()
    return WRONG.moved(scan, scan.points @ matrix.T, scan.spacecraft @ matrix.T)


def scans_checked(scans, caster):
    """Place check of each scan, and what scans differ by over the same ground."""
    options, known = ScaleOptions(), LidarPlacement()
    places = check_scans(scans, caster, prior=options.prior, known=known)
    compared = [compare_shots(scan, caster) for scan in scans]
    return places, compare_crossings(compared, options.prior, known)


class TestScansTurnedOneByOne:
    """Scans that are turned each on its own fit better at no place in common."""

    def test_right_scans_fit_where_they_are(self, scans):
        places, crossings = scans_checked(scans[1], scans[0])
        assert len(places.checks) == 4
        assert not any(places.misfits)
        assert scan_findings(places, crossings) == []

    def test_each_scan_turned_on_its_own_is_refused(self, scans):
        caster, right = scans
        wrong = [turned(scan, seed) for seed, scan in enumerate(right)]
        assert not check_place(join("S", wrong), caster, prior=ScaleOptions().prior).misfit
        places, crossings = scans_checked(wrong, caster)
        assert all(places.misfits)
        found = scan_findings(places, crossings)[0]
        assert (found.code, found.severity) == (Code.SCANS_FIT_ELSEWHERE, Severity.REFUSED)
        assert found.text.startswith("4 of 4 scans")

    def test_one_scan_of_four_is_named(self, scans):
        caster, right = scans
        names = [WRONG.moved(scan, scan.points, scan.spacecraft) for scan in right]
        names[2] = turned(names[2], 2)
        places, crossings = scans_checked(names, caster)
        assert places.misfits == (False, False, True, False)
        found = scan_findings(places, crossings)[0]
        assert (found.code, found.severity) == (Code.SCANS_FIT_ELSEWHERE, Severity.DOUBTFUL)
        assert found.text.startswith("1 of 4 scans")

    def test_few_shots_are_put_together(self, scans):
        caster, right = scans
        parts = [scan.select(np.arange(first, first + 20)) for scan in right for first in (0, 20)]
        places = check_scans(parts, caster, prior=ScaleOptions().prior, known=LidarPlacement())
        assert [len(names) for names in places.names] == [3, 5]


def test_scans_that_differ_over_the_same_ground_are_doubtful():
    """An error of the shape is common to all scans, however large; a turn of each is not."""
    mesh = body(1)
    rough = RayCaster(Mesh(mesh.vertices + 0.4 * wave(mesh.vertices), mesh.facets))
    scans = [shots_on(mesh, seed, count=3000) for seed in range(1, 4)]
    prior, known = ScaleOptions().prior, LidarPlacement()

    def ratio(caster, taken):
        found = compare_crossings([compare_shots(one, caster) for one in taken], prior, known)
        assert found.pairs > 100
        return found.between_m / found.within_m

    assert ratio(RayCaster(mesh), scans) < 1.3
    assert ratio(rough, scans) < 1.3
    apart = [turned(scan, number, 10.0) for number, scan in enumerate(scans)]
    assert ratio(RayCaster(mesh), apart) > CROSSING


def wave(points):
    """A displacement of some 30 m of wave length, along the radius."""
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    return unit * np.sin(points @ [0.2, 0.1, 0.15])[:, None]


def test_a_globe_without_relief_determines_the_size_and_no_longitude():
    mesh = body(1, relief=0.0)
    verdict = verdict_of(shots_on(mesh, 1, noise=0.2), RayCaster(mesh))
    assert verdict.judgement == "accepted"
    assert Code.SHOTS_FIT_BY_CHANCE in {found.code for found in verdict.findings}


def test_a_few_shots_are_not_tested():
    mesh = body(1)
    scan = shots_on(mesh, 1).select(np.arange(FEWEST_SHOTS - 1))
    check = check_place(scan, RayCaster(mesh), prior=ScaleOptions().prior)
    assert not check.misfit
    assert not check.by_chance


@pytest.mark.parametrize("count", [12, 26, 100])
def test_p_values_are_even_where_both_places_fit_alike(count):
    generator = np.random.default_rng(count)
    noise = generator.normal(size=(2000, 3, count))
    chances = np.array([chance_of_larger(e + a, e + b) for e, a, b in noise])
    # Three deviations of a count of 2000 draws.
    for level in (0.01, 0.05, 0.5):
        assert abs(np.mean(chances < level) - level) < 3.0 * np.sqrt(level * (1 - level) / 2000)
    assert np.mean(chances < 1e-3) < 4e-3


def test_shots_with_correlated_errors_count_as_fewer():
    generator = np.random.default_rng(1)
    rough = generator.normal(size=200)
    smooth = gaussian_filter1d(generator.normal(size=200), 5.0)
    assert independent(rough, smooth - smooth.mean()) > 150
    assert independent(smooth - smooth.mean(), smooth - smooth.mean()) < 40


def test_correct_shots_never_fit_elsewhere():
    """Errors here, and errors with another relief at each of 100 places: no false alarm in 20."""
    generator = np.random.default_rng(7)
    worst = 1.0
    for _ in range(20):
        here = generator.normal(size=100)
        relief = 2.0 * generator.normal(size=(100, 100))
        worst = min(worst, 100 * min(chance_of_larger(here, here + one) for one in relief))
    assert worst > 0.5


def test_a_scatter_far_beyond_stated_sigmas_is_doubtful():
    mesh = body(1)
    scan = shots_on(mesh, 1, noise=TOO_LARGE * 0.4)
    verdict = verdict_of(scan, RayCaster(mesh))
    assert Code.SCATTER_TOO_LARGE in {
        found.code for found in verdict.findings if found.severity is Severity.DOUBTFUL
    }


@pytest.mark.real_data
class TestRyugu:
    def test_the_shots_as_they_are_are_accepted(self, ryugu):
        assert verdict_of(*ryugu).judgement == "accepted"

    @pytest.mark.parametrize("name", NAMES)
    def test_altered_shots_are_not(self, ryugu, name):
        scan, caster = ryugu
        verdict = verdict_of(WRONG.altered(scan, name), caster)
        assert verdict is None or verdict.judgement != "accepted"

    @pytest.mark.parametrize("turn", [2.0, -2.0])
    def test_a_turn_by_two_degrees_is_recovered(self, ryugu, turn):
        scan, caster = ryugu
        matrix = Rotation.from_rotvec([0.0, 0.0, np.radians(turn)]).as_matrix()
        turned = WRONG.moved(scan, scan.points @ matrix.T, scan.spacecraft @ matrix.T)
        assert verdict_of(turned, caster).judgement == "accepted"
