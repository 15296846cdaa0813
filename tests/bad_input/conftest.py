"""A workspace that a whole run has finished."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from command_line import call
from damage import PAIR_SIZE, TINY, states

from fusion.truth import make_mission
from fusion.workspace.settings import load_settings, write_settings


@pytest.fixture(scope="session")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small synthetic mission; nobody changes it."""
    folder = tmp_path_factory.mktemp("bad input") / "mission"
    make_mission(folder, settings=TINY)
    return folder


@pytest.fixture(scope="session")
def finished(mission: Path) -> Path:
    """A workspace in a path with a space, in which all stages have run; nobody changes it."""
    root = mission.with_name("a finished workspace")
    call("init", root, "--spc", mission / "spc", "--body", "Truth")
    settings = load_settings(root / "spcola.toml").with_table("release", products=["map"])
    write_settings(root / "spcola.toml", settings.with_table("scale", size_m=PAIR_SIZE))
    call("import", root, *sorted((mission / "lidar").iterdir()))
    assert set(states(root).values()) == {"ran", "up to date"}
    return root


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished workspace, to be damaged."""
    root = tmp_path / "a copy"
    # Every writer replaces files whole, so that links to those of the finished one are enough.
    shutil.copytree(finished, root, symlinks=True, copy_function=_linked)
    return root


def _linked(source: str, target: str) -> None:
    """Link a file; the data base, which is written in place, is copied."""
    if source.endswith(".sqlite") or Path(source).is_symlink():
        shutil.copy2(source, target, follow_symlinks=False)
    else:
        os.link(source, target)
