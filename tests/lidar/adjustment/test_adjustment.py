"""Displacements of scans: planted ones recovered, unobservable ones left to the prior."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from lidar.adjustment import (
    AdjustmentOptions,
    OverlapEquations,
    RigidArcs,
    ScanAdjustment,
    adjust_scans,
    displacement_partials,
    overlap_equations,
)
from lidar.adjustment.overlaps import ground_shares
from lidar.formats.mapolas import read_adjustment, write_adjustment
from lidar.gridding import grid_returns
from lidar.scans import Returns
from spcola.arrays import FloatArray
from spcola.errors import FormatError, SettingsError
from spcola.grids import MapletGrid

AXES = np.linalg.qr(np.array([[1.0, 0.2, -0.1], [-0.3, 1.0, 0.2], [0.1, -0.2, 1.0]]))[0]
AXES = AXES * np.sign(np.linalg.det(AXES))
GRID = MapletGrid(np.array([200.0, 30.0, -40.0]), AXES, 0.5, 24)
NAMES = ("a", "b", "c", "alone")
CENTERS = GRID.center + np.array([[3.0, 0, 0], [0, 3.0, 0], [0, 0, 3.0], [400.0, 0, 0]])
ARCS = RigidArcs.whole(CENTERS)
OPTIONS = AdjustmentOptions(0.05, 5e-4)


def hills(x: FloatArray, y: FloatArray) -> FloatArray:
    """Heights along Uz, metres, of ground with relief in all directions."""
    return 0.6 * np.sin(0.9 * x + 0.3) * np.cos(0.7 * y) + 0.3 * np.sin(0.5 * x - 1.1 * y)


def scans_on(
    moved: FloatArray, rng: np.random.Generator, *, relief: float = 1.0, noise: float = 0.01
) -> Returns:
    """Three scans over the same ground, displaced and turned by `moved` (3, 6)."""
    points, scan = [], []
    for number in range(3):
        x, y = rng.uniform(-12, 12, size=(2, 12_000))
        height = relief * hills(x, y) + noise * rng.normal(size=x.size)
        place = GRID.center + np.stack([x, y, height], axis=1) @ GRID.axes
        points.append(place + displacement_partials(place, CENTERS[number]) @ moved[number])
        scan.append(np.full(x.size, number))
    together = np.concatenate(points)
    return Returns(together, np.full(len(together), noise), np.concatenate(scan), NAMES)


def adjusted(returns: Returns, rounds: int = 3, **options: object) -> ScanAdjustment:
    """Solve as the stage does."""
    chosen = AdjustmentOptions(0.05, 5e-4, **options)  # type: ignore[arg-type]
    found = ScanAdjustment.unadjusted(NAMES, ARCS, chosen)
    for _ in range(rounds):
        there = found.corrected(returns)
        equations = overlap_equations(grid_returns("A", GRID, there), there, CENTERS)
        found = adjust_scans(found, [] if equations is None else [equations], options=chosen)
    return found


def relative(values: FloatArray) -> FloatArray:
    """Displacements of the first three scans at the middle of the grid, less their mean."""
    rows = displacement_partials(np.broadcast_to(GRID.center, (3, 3)), CENTERS[:3])
    there = np.einsum("sij,sj->si", rows, values[:3])
    return there - there.mean(axis=0)


def test_planted_displacements_are_recovered_up_to_what_the_scans_share() -> None:
    rng = np.random.default_rng(1)
    moved = np.hstack([0.1 * rng.normal(size=(3, 3)), 2e-3 * rng.normal(size=(3, 3))])
    found = adjusted(scans_on(moved, rng))
    error = relative(found.displacement) - relative(moved)
    assert np.abs(error).max() < 1.5e-3
    assert np.abs(relative(moved)).max() > 0.05
    assert found.step_m < 1e-3
    assert adjusted(scans_on(moved, rng), rounds=1).step_m > 0.01


def test_what_is_left_is_of_the_size_of_its_covariance() -> None:
    pulls = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        moved = np.hstack([0.05 * rng.normal(size=(3, 3)), np.zeros((3, 3))])
        found = adjusted(scans_on(moved, rng, noise=0.02))
        error = relative(found.displacement) - relative(moved)
        rows = displacement_partials(np.broadcast_to(GRID.center, (3, 3)), CENTERS[:3])
        take = np.zeros((9, 24))
        for scan in range(3):
            for other in range(3):
                factor = (scan == other) - 1.0 / 3.0
                take[3 * scan : 3 * scan + 3, 6 * other : 6 * other + 6] = factor * rows[other]
        sigma = np.sqrt(np.diag(take @ found.covariance @ take.T))
        pulls.append(error.ravel() / sigma)
    assert 0.6 < np.std(pulls) < 1.6


def test_a_scan_that_meets_no_other_keeps_its_prior() -> None:
    rng = np.random.default_rng(2)
    moved = np.hstack([0.05 * rng.normal(size=(3, 3)), np.zeros((3, 3))])
    found = adjusted(scans_on(moved, rng, noise=0.03))
    assert found.displacement[3] == pytest.approx(np.zeros(6), abs=1e-15)
    prior = ARCS.prior(found.sizes)[18:, 18:]
    np.testing.assert_allclose(found.covariance[18:, 18:], prior, rtol=0.01, atol=1e-15)
    assert found.cells[3] == 0
    assert np.isnan(found.misfit[3])
    assert found.misfit[:3] == pytest.approx(1.0, abs=0.15)


def test_a_few_cells_that_meet_by_chance_move_nothing() -> None:
    """The fourth scan is far off; some of its outliers lie near the others."""
    rng = np.random.default_rng(7)
    moved = np.hstack([0.05 * rng.normal(size=(3, 3)), np.zeros((3, 3))])
    returns = scans_on(moved, rng)
    equations = overlap_equations(grid_returns("A", GRID, returns), returns, CENTERS)
    assert equations is not None
    alone = adjust_scans(
        ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS), [equations], options=OPTIONS
    )
    places = GRID.center + rng.uniform(-1, 1, (5, 3))
    chance = meeting((2, 3), places, GRID.uz, np.array([1.5, 0.2, 1.5, -0.9, 1.5]))
    both = adjust_scans(
        ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS), [equations, chance], options=OPTIONS
    )
    np.testing.assert_allclose(both.displacement, alone.displacement, atol=1e-6)
    assert both.displacement[3] == pytest.approx(np.zeros(6), abs=1e-12)
    prior = ARCS.prior(both.sizes)[18:, 18:]
    np.testing.assert_allclose(both.covariance[18:, 18:], prior, rtol=1e-6, atol=1e-15)
    assert both.cells[3] == 0
    assert np.isnan(both.misfit[3])
    assert both.suspects == ()


def meeting(
    scans: tuple[int, int], places: FloatArray, normal: FloatArray, apart: FloatArray
) -> OverlapEquations:
    """Cells (M,) in which the first scan lies `apart` above the second, metres ± 1 cm."""
    first, second = (normal @ displacement_partials(places, CENTERS[scan]) for scan in scans)
    rows, weight, count = np.concatenate([first, -second], axis=1), 1e4, len(places)
    energy = weight * float(apart @ apart)
    return OverlapEquations(
        scan=np.array(scans),
        normal=weight * rows.T @ rows,
        right=weight * rows.T @ apart,
        cells=np.full(2, float(count)),
        chi2=np.full(2, energy / 2.0),
        freedom=np.full(2, count / 2.0),
        weight=weight * count,
    )


def test_one_cell_of_outliers_does_not_turn_otherwise_free_scans() -> None:
    """Three scans that only touch each other may turn together as they like."""
    rng = np.random.default_rng(21)
    moved = np.hstack([0.05 * rng.normal(size=(3, 3)), np.zeros((3, 3))])
    returns = scans_on(moved, rng)
    equations = overlap_equations(grid_returns("A", GRID, returns), returns, CENTERS)
    assert equations is not None
    before, place = (
        ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS),
        GRID.center + np.array([[0.0, 9, 4]]),
    )
    alone = adjust_scans(before, [equations], options=OPTIONS)
    outlier = meeting((1, 3), place, GRID.uz, np.array([7.5]))
    with_outlier = adjust_scans(before, [equations, outlier], options=OPTIONS)
    np.testing.assert_array_equal(with_outlier.displacement, alone.displacement)
    np.testing.assert_array_equal(with_outlier.cells, alone.cells)
    assert with_outlier.step_m == pytest.approx(alone.step_m)


def test_a_cell_that_agrees_with_the_others_counts() -> None:
    places = GRID.center + np.random.default_rng(22).uniform(-9, 9, (40, 3))
    before = ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS)
    sound = meeting((0, 1), places, GRID.uz, np.full(40, 0.08))
    few = meeting((0, 1), places[:3], GRID.ux, np.full(3, 0.06))
    for _ in range(3):
        still = [of_adjustment(before, part) for part in (sound, few)]
        before = adjust_scans(before, still, options=OPTIONS)
    assert before.cells[0] == 43
    here = np.linalg.norm(before.displacement[0, :3] - before.displacement[1, :3])
    left = [of_adjustment(before, part).chi2.sum() / part.chi2.sum() for part in (sound, few)]
    assert here > 0.08
    assert max(left) < 0.05


def test_tracks_that_cross_judge_each_other() -> None:
    """Nothing but crossings, a metre apart where centimetres were expected; two are outliers."""
    rng = np.random.default_rng(23)
    moved = rng.normal(size=(4, 3))
    crossings = []
    for number in range(60):
        first, second = rng.choice(4, 2, replace=False)
        normal, place = rng.normal(size=3), GRID.center + rng.uniform(-20, 20, (1, 3))
        normal /= np.linalg.norm(normal)
        apart = normal @ (moved[first] - moved[second]) + 0.01 * rng.normal()
        outlier = 40.0 if number in (7, 30) else 0.0
        crossings.append(meeting((first, second), place, normal, np.array([apart + outlier])))
    found = ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS)
    for _ in range(3):
        still = [of_adjustment(found, part) for part in crossings]
        found = adjust_scans(found, still, options=OPTIONS)
    assert found.cells.sum() == 2 * 58
    left = np.sqrt([of_adjustment(found, part).chi2.sum() for part in crossings])
    assert np.median(left) < 2.0
    assert np.median(np.sqrt([part.chi2.sum() for part in crossings])) > 30.0


def of_adjustment(found: ScanAdjustment, part: OverlapEquations) -> OverlapEquations:
    """Equations of what is left where returns are corrected by `found`."""
    step = found.displacement[part.scan].ravel()
    energy = part.chi2.sum() - 2.0 * part.right @ step + step @ part.normal @ step
    return replace(part, right=part.right - part.normal @ step, chi2=np.full(2, energy / 2.0))


def test_the_size_of_the_displacements_is_estimated() -> None:
    rng = np.random.default_rng(3)
    moved = np.hstack([1.0 * rng.normal(size=(3, 3)), np.zeros((3, 3))])
    returns = scans_on(moved, rng)
    sizes = adjusted(returns, rounds=6).sizes
    assert 0.3 < np.hypot(sizes.up_m, sizes.across_m) < 3.0
    assert adjusted(returns, estimate=False).sizes == AdjustmentOptions(0.05, 5e-4).sizes


def test_flat_ground_determines_heights_and_not_horizontal_displacements() -> None:
    rng = np.random.default_rng(4)
    moved = np.zeros((3, 6))
    moved[0, :3] = 0.08 * GRID.uz
    found = adjusted(scans_on(moved, rng, relief=0.0), estimate=False)
    local = relative(found.displacement) @ GRID.axes.T
    assert local[0, 2] - local[1, 2] == pytest.approx(0.08, abs=2e-3)
    # The sideways part is hardly observable, and its stated uncertainty is that of the prior.
    assert np.abs(local[:, :2]).max() < 0.05
    for scan in range(3):
        block = found.covariance[6 * scan : 6 * scan + 3, 6 * scan : 6 * scan + 3]
        for axis in (GRID.ux, GRID.uy):
            assert np.sqrt(axis @ block @ axis) == pytest.approx(0.05, rel=0.15)


def test_one_scan_alone_gives_no_equations() -> None:
    rng = np.random.default_rng(5)
    returns = scans_on(np.zeros((3, 6)), rng)
    single = returns.select(returns.scan == 1)
    assert overlap_equations(grid_returns("A", GRID, single), single, CENTERS) is None


def test_what_moves_all_scans_alike_is_not_seen() -> None:
    returns = scans_on(np.zeros((3, 6)), np.random.default_rng(6))
    gridding = grid_returns("A", GRID, returns)
    whole = overlap_equations(gridding, returns, CENTERS)
    assert whole is not None
    size = np.abs(whole.normal).max()
    common = np.tile(np.eye(6)[:3], 3)
    assert np.abs(whole.normal @ common.T).max() < 1e-9 * size
    assert np.linalg.eigvalsh(whole.normal).min() > -1e-9 * size
    # The same ground is compared on two grids.
    half = overlap_equations(gridding, returns, CENTERS, others=[GRID])
    assert half is not None
    np.testing.assert_allclose(half.normal, 0.5 * whole.normal, rtol=0, atol=1e-9 * size)


def test_a_scan_of_other_ground_is_named() -> None:
    rng = np.random.default_rng(7)
    returns = scans_on(np.zeros((3, 6)), rng)
    points = returns.points.copy()
    last = returns.scan == 2
    points[last] += 0.3 * np.sin(2.1 * points[last, :1]) * GRID.uz
    many = Returns(points, returns.sigma, returns.scan, NAMES)
    found = adjusted(many)
    clean = adjusted(returns)
    assert clean.suspects == ()
    assert found.misfit[2] > 3.0 * np.median(clean.misfit[:3])


def test_returns_of_unknown_sigma_and_spread_do_not_rule_the_others() -> None:
    """Single returns in a corner of two scans: neither file nor cells determine their noise."""
    rng = np.random.default_rng(12)
    place = GRID.points(np.zeros(GRID.shape))[18:30, 18:30].reshape(-1, 3)
    noise = 0.03 * rng.normal(size=(2, len(place), 1)) * GRID.uz
    points = np.concatenate([place + noise[0], place + noise[1]])
    scan = np.repeat([0, 1], len(place))
    lonely = Returns(points, np.full(len(points), np.nan), scan, NAMES)
    gridding = grid_returns("A", GRID, lonely)
    equations = overlap_equations(gridding, lonely, CENTERS)
    assert equations is not None
    assert np.all(equations.chi2 < 5.0 * np.maximum(equations.freedom, 1.0))
    moved = np.hstack([0.05 * rng.normal(size=(3, 3)), np.zeros((3, 3))])
    returns = scans_on(moved, rng)
    good = overlap_equations(grid_returns("A", GRID, returns), returns, CENTERS)
    before = ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS)
    found = adjust_scans(before, [good, equations], options=OPTIONS)
    assert np.abs(relative(found.displacement) - relative(moved)).max() < 0.01


def test_one_scan_that_fits_nowhere_does_not_loosen_the_others() -> None:
    rng = np.random.default_rng(13)
    moved = np.hstack([0.05 * rng.normal(size=(3, 3)), np.zeros((3, 3))])
    returns = scans_on(moved, rng)
    good = overlap_equations(grid_returns("A", GRID, returns), returns, CENTERS)
    assert good is not None
    wild = replace(good, scan=np.array([2, 3]), normal=np.zeros((12, 12)), right=np.zeros(12),
                   cells=np.full(2, 50.0), chi2=np.array([0, 1e9]), freedom=np.ones(2))  # fmt: skip
    before = ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS)
    alone = adjust_scans(before, [good], options=OPTIONS)
    found = adjust_scans(before, [good, wild], options=OPTIONS)
    assert found.suspects == ("alone",)
    np.testing.assert_allclose(found.displacement, alone.displacement, atol=1e-3)


def test_ground_under_two_grids_counts_half() -> None:
    off_side = MapletGrid(GRID.center + 12.0 * GRID.ux, GRID.axes, GRID.gsd, GRID.half_size)
    shares = ground_shares(GRID, [off_side], np.zeros(GRID.shape))
    assert set(np.unique(shares)) == {0.5, 1.0}
    assert np.all(shares[:, 24:] == 0.5)
    assert np.all(shares[:, :24] == 1.0)


def test_corrected_undoes_a_small_displacement() -> None:
    rng = np.random.default_rng(8)
    moved = np.zeros((4, 6))
    moved[:3] = np.hstack([0.1 * rng.normal(size=(3, 3)), 1e-4 * rng.normal(size=(3, 3))])
    still, displaced = (scans_on(m, np.random.default_rng(9)) for m in (np.zeros((3, 6)), moved))
    adjustment = ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS)
    whole = ScanAdjustment(**{**vars(adjustment), "displacement": moved})
    np.testing.assert_allclose(whole.corrected(displaced).points, still.points, atol=3e-5)
    other = Returns(still.points, still.sigma, still.scan, ("x", "y", "z", "w"))
    np.testing.assert_array_equal(whole.corrected(other).points, other.points)


def test_an_adjustment_is_read_as_it_was_written(tmp_path: Path) -> None:
    found = adjusted(scans_on(np.zeros((3, 6)), np.random.default_rng(11)))
    path = tmp_path / "adjustment.h5"
    write_adjustment(path, found)
    back = read_adjustment(path)
    np.testing.assert_array_equal(back.arcs.center, CENTERS)
    np.testing.assert_array_equal(back.arcs.scan, ARCS.scan)
    np.testing.assert_array_equal(back.arcs.day, ARCS.day)
    for name, value in vars(found).items():
        if name != "arcs":
            np.testing.assert_array_equal(getattr(back, name), value)


def test_a_damaged_adjustment_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "adjustment.h5"
    path.write_bytes(b"no HDF5")
    with pytest.raises(FormatError, match="make the mapolas again"):
        read_adjustment(path)
    found = ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS)
    write_adjustment(path, found)
    content = path.read_bytes()
    # HDF5 has a sum of each of its structures, names of forms included.
    path.write_bytes(content.replace(b"scan adjustment 2", b"scan adjustment 9"))
    with pytest.raises(FormatError, match="is damaged"):
        read_adjustment(path)
    path.write_bytes(content)
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = "spcola scan adjustment 9"
    with pytest.raises(FormatError, match="but not 'spcola scan adjustment 2'"):
        read_adjustment(path)


@pytest.mark.parametrize(
    ("layer", "value"),
    [("covariance", np.nan), ("covariance", -1.0), ("covariance", 0.0), ("displacement", np.inf)],
)
def test_an_adjustment_that_is_none_is_refused(tmp_path: Path, layer: str, value: float) -> None:
    """Eigenvalues of such a covariance may never be found."""
    path = tmp_path / "adjustment.h5"
    write_adjustment(path, ScanAdjustment.unadjusted(NAMES, ARCS, OPTIONS))
    with h5py.File(path, "r+") as file:
        file[layer][0, 0] = value
    with pytest.raises(FormatError, match=layer):
        read_adjustment(path)


@pytest.mark.parametrize(
    "name", ["offset_sigma_m", "rotation_sigma_rad", "wander_sigma_m", "day_sigma_m"]
)
def test_sizes_must_be_positive(name: str) -> None:
    with pytest.raises(SettingsError, match=name):
        AdjustmentOptions(**{name: 0.0})
