"""A workspace that a whole run has finished."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from command_line import call
from damage import PAIR_SIZE, TINY, states

from fusion.runtime.folders.lock import LOCK_FILE
from fusion.truth import make_mission
from fusion.workspace.settings import load_settings, write_settings


def _made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Return a folder that the first of the test processes makes; the others wait for it."""
    base = factory.getbasetemp()
    place = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "bad input"
    place.mkdir(exist_ok=True)
    with (place / f"{name}.lock").open("a+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        lock.seek(0)
        if not lock.read():
            make(place / name)
            lock.write("made")
    return place / name


@pytest.fixture(scope="session")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small synthetic mission; nobody changes it: other processes of tests use it, too."""
    return _made_once(tmp_path_factory, "mission", partial(make_mission, settings=TINY))


@pytest.fixture(scope="session")
def finished(mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace in a path with a space, in which all stages have run; nobody changes it."""
    return _made_once(tmp_path_factory, "a finished workspace", partial(_finish, mission))


def _finish(mission: Path, root: Path) -> None:
    call("init", root, "--spc", mission / "spc", "--body", "Truth")
    settings = load_settings(root / "spcola.toml").with_table("release", products=["map"])
    write_settings(root / "spcola.toml", settings.with_table("scale", size_m=PAIR_SIZE))
    call("import", root, *sorted((mission / "lidar").iterdir()))
    assert set(states(root).values()) == {"ran", "up to date"}


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished workspace, to be damaged."""
    root = tmp_path / "a copy"
    # Every writer replaces files whole, so that links to those of the finished one are enough.
    shutil.copytree(finished, root, symlinks=True, copy_function=_linked)
    return root


def _linked(source: str, target: str) -> None:
    """Link a file; the data base, which is written in place, and locks, which lock a file and all
    its links, are copied."""
    if source.endswith((".sqlite", LOCK_FILE)) or Path(source).is_symlink():
        shutil.copy2(source, target, follow_symlinks=False)
    else:
        os.link(source, target)
