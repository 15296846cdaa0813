"""Displacements of mapolas with planted errors, for tests of the fit."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fusion.registration.fit import FitOptions, ScanErrorPatterns
from fusion.registration.fit.fit import fit_transform
from spcola.math import Affine, Similarity, lattice

PLANTED = Similarity.from_rotation_vector(
    np.radians([0.002, -0.003, 0.011]), [0.05, -0.04, 0.06], 1.0005, "spc", "lidar"
)


def body(count=120, radius=245.0):
    """Mapola centres all over a body."""
    return radius * lattice(count)


def cap(count=25, radius=245.0, share=0.06):
    """Mapola centres on its north pole alone."""
    return radius * lattice(int(count / share))[:count]


def strained(truth, strain):
    """`truth` after a symmetric strain of the lidar frame."""
    matrix = truth.as_affine().matrix @ (np.eye(3) + np.array(strain))
    return Affine(matrix, truth.translation, "spc", "lidar")


def registered(points, seed, *, truth=PLANTED, sigma=0.02, scan_sigma=0.03, scans=12, **given):
    """Fit to mapolas at `points` with errors of `sigma`, and scan errors of `scan_sigma`.

    Maplet centres have errors of 1 cm in addition.

    `given`: `model`; `covariance` (3, 3) or (N, 3, 3) of the matches if not σ², `drawn` if their
    errors are of another; `extra` (N, 3), metres, that is added to the displacements.
    """
    generator = np.random.default_rng(seed)
    shares = np.eye(scans)[generator.permutation(len(points)) % scans]
    names = [f"scan{number}" for number in range(scans)]
    effects = ScanErrorPatterns.independent(names, 0.03).at(shares, np.asarray(points))
    moved = truth.apply(points) - points + given.get("extra", 0.0)
    moved = moved + shares @ (scan_sigma * generator.normal(size=(scans, 3)))
    covariance = given.get("covariance", sigma**2 * np.eye(3))
    covariances = np.broadcast_to(covariance, (len(points), 3, 3))
    root = np.linalg.cholesky(np.broadcast_to(given.get("drawn", covariance), covariances.shape))
    moved = moved + np.einsum("nij,nj->ni", root, generator.normal(size=points.shape))
    moved = moved + 0.01 * generator.normal(size=points.shape)
    options = FitOptions(model=given.get("model", "similarity"), center_sigma_m=0.01)
    return fit_transform(points, moved, covariances, effects, options=options)


@pytest.fixture
def scene():
    """What the tests plant, and the fit to it."""
    return SimpleNamespace(
        planted=PLANTED, body=body, cap=cap, strained=strained, registered=registered
    )
