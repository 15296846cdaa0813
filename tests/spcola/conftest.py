"""Photographs of waves on a plane."""

from __future__ import annotations

import pytest
from photographs import Cap, Painted, Ridge, Waves

from spcola.grids import MapletGrid


@pytest.fixture(scope="session")
def waves() -> Waves:
    """Ground of 30 m around a grid of 0.5 m."""
    return Waves(MapletGrid.facing([80.0, 20.0, 10.0], [0.9, 0.3, 0.2], 0.5, 30))


@pytest.fixture(scope="session")
def cap(waves) -> Cap:
    """The same on a ball."""
    return Cap(waves.grid)


@pytest.fixture(scope="session")
def painted(waves) -> Painted:
    """The waves with an albedo."""
    return Painted(waves.grid)


@pytest.fixture(scope="session")
def ridge(waves) -> Ridge:
    """A painted ridge."""
    return Ridge(waves.grid)
