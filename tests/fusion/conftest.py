"""A fused maplet with every kind of point, on a grid that no axis flatters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from solved_workspace import solved_workspace

from fusion.fusing.maplets import FusedMaplet, Source
from fusion.products import Provenance
from spcola.grids import MapletGrid
from spcola.math import Similarity


def build_fused(name: str = "BE0042", half_size: int = 24, seed: int = 3) -> FusedMaplet:
    rng = np.random.default_rng(seed)
    place = np.array([0.41, 0.37, 0.83]) * 250.0
    tilted = Similarity.from_rotation_vector([0.2, -0.1, 1.3]).turn(
        MapletGrid.facing(place, place, 0.35, half_size).axes
    )
    grid = MapletGrid(place, tilted, 0.35, half_size)
    height = rng.normal(0.0, 0.7, grid.shape)
    source = rng.integers(1, 5, grid.shape)
    missing = rng.random(grid.shape) < 0.1
    source[missing] = Source.NONE
    height[missing] = np.nan
    sigma = np.where(missing, np.nan, rng.uniform(0.01, 0.2, grid.shape))
    albedo = rng.uniform(0.6, 1.6, grid.shape)
    count = rng.integers(0, 40, grid.shape)
    return FusedMaplet(
        name, grid, height, albedo, sigma, np.array([0.02, 0.03, np.nan]), count, source
    )


@pytest.fixture
def fused() -> FusedMaplet:
    return build_fused()


@pytest.fixture
def make_fused():
    return build_fused


@pytest.fixture
def provenance() -> Provenance:
    return Provenance("Bennu", {"fused/fused.h5": "ab" * 32}, {"fuse": {"loss": "huber"}})


@pytest.fixture
def assert_same():
    return check_same


def check_same(found, wanted, *, everywhere: bool = True) -> None:
    """Assert that two maplets are one, bit for bit (at valid points only unless `everywhere`)."""
    assert type(found) is type(wanted)
    assert found.name == wanted.name
    np.testing.assert_array_equal(found.grid.center, wanted.grid.center)
    np.testing.assert_array_equal(found.grid.axes, wanted.grid.axes)
    assert (found.grid.gsd, found.grid.half_size) == (wanted.grid.gsd, wanted.grid.half_size)
    np.testing.assert_array_equal(found.center_sigma, wanted.center_sigma)
    where = np.ones(wanted.grid.shape, bool) if everywhere else wanted.valid
    np.testing.assert_array_equal(found.valid, wanted.valid)
    for layer in ("height", "sigma", "albedo", "count", "source"):
        if hasattr(wanted, layer):
            np.testing.assert_array_equal(
                getattr(found, layer)[where], getattr(wanted, layer)[where], err_msg=layer
            )


@pytest.fixture(scope="session")
def solved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A workspace with a maplet solved from photographs, and what that printed: not to change."""
    root = tmp_path_factory.mktemp("solved") / "waves"
    return root, solved_workspace(root)
