"""Displacements of many scans on many grids, and the sizes of what errs, from planted ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidar.adjustment import OverlapEquations, RigidArcs, ScanErrorSizes, displacement_partials
from lidar.adjustment.normal_equations import solve_network
from spcola.arrays import FloatArray

RADIUS = 240.0
FIRST = ScanErrorSizes(0.05, 0.05, 5e-5, 5e-4, 0.02)


def places(rng: np.random.Generator, count: int, *, spread: float = 1e9) -> FloatArray:
    """Points all over a sphere, or `spread` about one."""
    directions = np.array([0.0, 0.0, 1.0]) + spread * rng.normal(size=(count, 3))
    found: FloatArray = RADIUS * directions / np.linalg.norm(directions, axis=1)[:, None]
    return found


def on_days(centers: FloatArray, days: int) -> RigidArcs:
    """Scans dealt to so many days."""
    every = np.arange(len(centers))
    return RigidArcs(centers, every, every % days)


def drawn(rng: np.random.Generator, arcs: RigidArcs, sizes: ScanErrorSizes) -> FloatArray:
    """Displacements (S, 6) of the stated sizes."""
    root = np.linalg.cholesky(arcs.prior(sizes))
    found: FloatArray = (root @ rng.normal(size=len(root))).reshape(-1, 6)
    return found


def overlap(
    rng: np.random.Generator,
    scans: FloatArray,
    moved: FloatArray,
    centers: FloatArray,
    *,
    wander: float,
    cells: int = 400,
    noise: float = 0.01,
) -> OverlapEquations:
    """Heights that the scans (K,) have in the cells of one grid, the ground of each unknown."""
    middle = centers[scans].mean(axis=0)
    spot = middle + rng.uniform(-15, 15, (cells, 3))
    normal = middle / np.linalg.norm(middle) + 0.3 * rng.normal(size=(cells, 3))
    rows = np.stack([np.einsum("ci,cij->cj", normal, displacement_partials(spot, centers[s]))
                     for s in scans])  # fmt: skip
    own = wander * rng.normal(size=(len(scans), 3))
    height = np.einsum("kcj,kj->kc", rows, moved[scans]) + own @ normal.T
    height += noise * rng.normal(size=height.shape)
    # The mean of each cell is the ground.
    departure, less = height - height.mean(axis=0), np.eye(len(scans)) - 1.0 / len(scans)
    design = np.einsum("kl,lcj->kclj", less, rows).reshape(-1, 6 * len(scans))
    weight = noise**-2
    return OverlapEquations(
        scan=scans,
        normal=weight * design.T @ design,
        right=weight * design.T @ departure.ravel(),
        cells=np.full(len(scans), float(cells)),
        chi2=weight * np.sum(departure**2, axis=1),
        freedom=np.full(len(scans), cells * (1.0 - 1.0 / len(scans))),
        weight=weight * cells * (len(scans) - 1),
    )


def network(
    rng: np.random.Generator,
    sizes: ScanErrorSizes,
    *,
    scans: int = 40,
    days: int = 8,
    grids: int = 120,
    spread: float = 1e9,
) -> tuple[RigidArcs, FloatArray, list[OverlapEquations]]:
    """Scans, planted displacements, and overlaps of neighbouring scans."""
    centers = places(rng, scans, spread=spread)
    arcs = on_days(centers, days)
    moved = drawn(rng, arcs, sizes)
    parts = []
    for _ in range(grids):
        here = places(rng, 1, spread=spread)
        near = np.sort(np.argsort(np.linalg.norm(centers - here, axis=1))[:3])
        parts.append(overlap(rng, near, moved, centers, wander=sizes.wander_m))
    return arcs, moved, parts


def test_the_sizes_of_all_errors_are_found() -> None:
    """Over a few networks: one network is a few draws of each."""
    true = ScanErrorSizes(0.03, 0.09, 2e-4, 4e-3, 0.05)
    found = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        arcs, _, parts = network(rng, true, scans=60, days=20, grids=180)
        found.append(solve_network(parts, arcs, FIRST).sizes.all)
    np.testing.assert_allclose(np.mean(found, axis=0), true.all, rtol=0.25)


def test_what_is_left_is_of_the_size_of_its_covariance_also_where_scans_wander() -> None:
    true = ScanErrorSizes(0.05, 0.07, 1e-4, 3e-3, 0.02)
    pulls, blind = [], []
    for seed in range(6):
        arcs, moved, parts = network(np.random.default_rng(seed), true)
        found = solve_network(parts, arcs, FIRST)
        rigid = solve_network(parts, arcs, replace(true, wander_m=1e-6), estimate=False)
        for solution, collected in ((found, pulls), (rigid, blind)):
            values, vectors = np.linalg.eigh(solution.covariance)
            left = vectors.T @ (solution.displacement - moved.ravel())
            collected.append(np.mean(left**2 / values))
    assert np.mean(pulls) == pytest.approx(1.0, abs=0.15)
    assert np.mean(blind) > 3.0


def test_scans_that_nothing_holds_do_not_speak_for_the_first_guess() -> None:
    """Two thirds of the scans meet none: the sizes are those of the others all the same."""
    true = ScanErrorSizes(0.5, 0.5, 1e-4, 1e-3, 0.02)
    rng = np.random.default_rng(3)
    arcs, _, parts = network(rng, true)
    alone = RigidArcs(
        np.vstack([arcs.center, places(rng, 80)]), np.arange(120), np.append(arcs.day, [-1] * 80)
    )
    few, many = (solve_network(parts, those, FIRST).sizes for those in (arcs, alone))
    np.testing.assert_allclose(many.all, few.all, rtol=0.02)
    assert 0.3 < many.up_m < 0.8


def test_arcs_of_a_scan_are_one_draw_of_its_error() -> None:
    """Tracks around the body, each displaced as a whole: what all share is no better known."""
    true = ScanErrorSizes(0.05, 0.05, 1e-6, 1e-6, 0.02)
    scan = np.concatenate([np.arange(20), np.repeat([20, 21], 40)])
    found: dict[str, list[FloatArray]] = {"arcs": [], "scans": []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        centers = places(rng, len(scan))
        moved = drawn(rng, RigidArcs.whole(places(rng, 22)), true)[scan]
        parts = [
            overlap(rng, np.sort(rng.choice(len(scan), 3, replace=False)), moved, centers, wander=0)
            for _ in range(150)
        ]
        for name, arcs in (
            ("arcs", RigidArcs(centers, scan, np.full(len(scan), -1))),
            ("scans", RigidArcs.whole(centers)),
        ):
            solution = solve_network(parts, arcs, true, estimate=False)
            left = (solution.displacement - moved.ravel()).reshape(-1, 6)[:, :3].mean(axis=0)
            blocks = solution.covariance.reshape(len(scan), 6, len(scan), 6)[:, :3, :, :3]
            found[name].append(left / np.sqrt(np.diag(blocks.mean(axis=(0, 2)))))
    # 1.1 is expected where arcs are taken to be alike by half but are so altogether; 5.7 where not.
    assert np.std(found["arcs"]) < 1.5
    assert np.std(found["scans"]) > 3.0


def test_precision_is_the_inverse_of_what_arcs_have_alike() -> None:
    centers = places(np.random.default_rng(6), 5)
    arcs = RigidArcs(centers, np.array([0, 1, 1, 1, 2]), np.full(5, -1))
    prior = arcs.prior(ScanErrorSizes(1.0, 1.0, 1.0, 1.0, 1.0))
    np.testing.assert_allclose(prior[6:9, 12:15], 0.5 * np.eye(3), atol=1e-14)
    np.testing.assert_allclose(prior[:3, 6:9], 0.0, atol=1e-14)
    local = RigidArcs(np.zeros((5, 3)), arcs.scan, arcs.day)
    together = local.precision @ local.prior(ScanErrorSizes(1.0, 1.0, 1.0, 1.0, 1.0))
    np.testing.assert_allclose(together, np.eye(30), atol=1e-12)
    assert arcs.share.tolist() == [1.0, 1 / 3, 1 / 3, 1 / 3, 1.0]


def test_given_sizes_are_kept() -> None:
    arcs, _, parts = network(np.random.default_rng(5), FIRST)
    assert solve_network(parts, arcs, FIRST, estimate=False).sizes == FIRST
    assert solve_network([], arcs, FIRST).sizes == FIRST


def test_ranges_of_few_days_determine_the_radius_less_than_many_scans() -> None:
    """Of a part of the body: around it, chains of overlaps close, and determine the radius."""
    true = ScanErrorSizes(0.03, 0.03, 1e-4, 1e-5, 0.06)
    alone = replace(true, up_m=float(np.hypot(true.up_m, true.day_m)))
    pulls: dict[str, list[float]] = {"days": [], "scans": []}
    for seed in range(60):
        arcs, moved, parts = network(np.random.default_rng(seed), true, grids=50, spread=0.1)
        up = arcs.center / RADIUS
        lifted = np.hstack([up, np.zeros_like(up)]).ravel() / len(up)
        scans = RigidArcs.whole(arcs.center)
        for name, those, sizes in (("days", arcs, true), ("scans", scans, alone)):
            found = solve_network(parts, those, sizes, estimate=False)
            left = lifted @ (found.displacement - moved.ravel())
            pulls[name].append(left / np.sqrt(lifted @ found.covariance @ lifted))
    assert np.sqrt(np.mean(np.square(pulls["days"]))) == pytest.approx(1.0, abs=0.25)
    assert np.sqrt(np.mean(np.square(pulls["scans"]))) > 1.5


def test_a_day_lifts_all_its_scans() -> None:
    arcs = on_days(places(np.random.default_rng(7), 12), 3)
    prior = arcs.prior(ScanErrorSizes(1e-9, 1e-9, 1e-9, 1e-9, 0.1)).reshape(12, 6, 12, 6)
    up = arcs.center / RADIUS
    lifted = np.einsum("ki,kilj,lj->kl", up, prior[:, :3, :, :3], up)
    same = arcs.day[:, None] == arcs.day
    np.testing.assert_allclose(lifted, np.where(same, 0.01, 0.0), atol=1e-12)


def test_the_prior_errs_across_the_radius_more_than_along_it() -> None:
    center = np.array([[0.0, 0.0, -200.0], [100.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    prior = RigidArcs.whole(center).prior(ScanErrorSizes(0.03, 0.07, 1e-4, 1e-3, 0.02))
    variances = np.diag(prior).reshape(3, 6)
    assert np.sqrt(variances[0, :3]) == pytest.approx([0.07, 0.07, 0.03])
    assert np.sqrt(variances[1, :3]) == pytest.approx([0.03, 0.07, 0.07])
    assert np.sqrt(variances[:, 3:]) == pytest.approx(np.full((3, 3), 1e-4))
    np.testing.assert_allclose(prior, np.diag(np.diag(prior)), atol=1e-15)
