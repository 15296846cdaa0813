"""What the errors of scans do to mapolas."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.registration.fit import ScanErrorPatterns
from lidar.adjustment import (
    AdjustmentOptions,
    RigidArcs,
    ScanAdjustment,
    displacement_partials,
)
from spcola.arrays import FloatArray

NAMES = ("a", "b", "c")
CENTERS = np.array([[200.0, 0.0, 0.0], [0.0, 210.0, 0.0], [0.0, 0.0, -190.0]])


@pytest.fixture
def adjustment() -> ScanAdjustment:
    """Scans known to a metre, to millimetres and to tenths of them in turn, not independently."""
    rng = np.random.default_rng(1)
    sizes = np.repeat([1.0, 2e-3, 1e-4], 6) * np.tile([1, 1, 1, 5e-3, 5e-3, 5e-3], 3)
    mixing = np.eye(18) + 0.2 * rng.normal(size=(18, 18))
    root = sizes[:, None] * mixing
    before = ScanAdjustment.unadjusted(
        NAMES, RigidArcs.whole(CENTERS), AdjustmentOptions(wander_sigma_m=7e-4)
    )
    return ScanAdjustment(**{**vars(before), "covariance": root @ root.T})


def placed(count: int) -> tuple[FloatArray, FloatArray]:
    """Shares (N, S) and centres (N, 3) of mapolas."""
    rng = np.random.default_rng(2)
    shares = rng.dirichlet(np.ones(3), size=count)
    return shares, CENTERS[rng.integers(3, size=count)] + rng.normal(scale=20, size=(count, 3))


def test_patterns_and_residual_covariance_add_up_to_the_covariance(
    adjustment: ScanAdjustment,
) -> None:
    shares, points = placed(7)
    scans = ScanErrorPatterns.of_adjustment(adjustment, shares, points)
    effects, rest = scans.at(shares, points), scans.residual_covariance(shares, points)
    rows = displacement_partials(points[:, None], CENTERS)
    displaced = np.einsum("ns,nsij->nisj", shares, rows).reshape(7, 3, 18)
    whole = np.einsum("nip,pq,njq->nij", displaced, adjustment.covariance, displaced)
    whole += 7e-4**2 * np.sum(shares**2, axis=1)[:, None, None] * np.eye(3)
    found = np.einsum("nip,njp->nij", effects, effects) + rest
    np.testing.assert_allclose(found, whole, rtol=1e-9, atol=1e-15)


def test_patterns_that_move_no_mapola_are_left_out(adjustment: ScanAdjustment) -> None:
    shares, points = placed(7)
    all_of_them = ScanErrorPatterns.of_adjustment(adjustment, shares, points)
    last = np.tile([0.0, 0.0, 1.0], (7, 1))
    third = ScanErrorPatterns.of_adjustment(adjustment, last, points)
    assert 6 <= all_of_them.modes.shape[1] < 18
    assert third.modes.shape[1] == 0
    assert third.at(last, points).shape == (7, 3, 0)
    sigma = np.sqrt(np.einsum("nii->ni", third.residual_covariance(last, points)))
    assert sigma.min() > 7e-4
    assert sigma.max() < 2e-3


def test_many_mapolas_are_as_few(adjustment: ScanAdjustment) -> None:
    shares, points = placed(1100)
    scans = ScanErrorPatterns.of_adjustment(adjustment, shares, points)
    some = slice(600, 640)
    np.testing.assert_allclose(
        scans.at(shares, points)[some], scans.at(shares[some], points[some]), atol=1e-15
    )
    np.testing.assert_allclose(
        scans.residual_covariance(shares, points)[some],
        scans.residual_covariance(shares[some], points[some]),
        rtol=1e-12,
    )


def test_without_an_adjustment_each_scan_errs_by_itself() -> None:
    shares, points = placed(5)
    scans = ScanErrorPatterns.independent(NAMES, 0.04)
    assert scans.at(shares, points).shape == (5, 3, 9)
    assert not scans.residual_covariance(shares, points).any()
    assert ScanErrorPatterns.independent(NAMES, 0.0).at(shares, points).shape == (5, 3, 0)
