"""Photographs of painted waves."""

from __future__ import annotations

import pytest
from photographs import Painted
from solved_photographs import photographs_of

from spcola.camera import SpcImage


@pytest.fixture(scope="session")
def photographs(painted: Painted) -> list[SpcImage]:
    """Six images of it, each in other light."""
    return photographs_of(painted)
