"""A workspace for the tests of the service, and what the commands make of it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from command_line import called
from served import make_ball


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maplets in a row on hills, under two scans; nobody changes it."""
    root = tmp_path_factory.mktemp("service") / "ball"
    make_ball(root)
    return root


@pytest.fixture(scope="session")
def by_command(ball: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """The workspace after the command ``mapolas``, and what that printed; nobody changes it."""
    root = shutil.copytree(ball, tmp_path_factory.mktemp("command") / "ball")
    return root, called("mapolas", root)
