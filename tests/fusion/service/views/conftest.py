"""A workspace of a ball."""

from __future__ import annotations

from pathlib import Path

import pytest
from ball import ball_workspace

from fusion.workspace import Workspace


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return ball_workspace(tmp_path / "ball")
