"""The stage fuse through the command line: maplets whose heights the lidar contradicts."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app
from scipy import ndimage
from typer.testing import CliRunner

from fusion.workspace import new_workspace
from lidar.formats.mapolas import write_mapolas
from lidar.gridding import Mapola
from spcola.arrays import FloatArray
from spcola.formats.maplets import read_maplet, write_maplet
from spcola.grids import Maplet, MapletGrid
from spcola.math import lattice

RADIUS, GSD, HALF, COUNT = 60.0, 0.5, 20, 12
ACCEPT = ("--accept", "maplet-contradicted")


def call(*arguments: object, code: int = 0) -> Any:
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert result.exit_code == code, result.output
    return result


def terrain(seed: int) -> FloatArray:
    noise = np.random.default_rng(seed).normal(size=(2 * HALF + 1, 2 * HALF + 1))
    rough = ndimage.gaussian_filter(noise, 1.5, mode="wrap")
    surface: FloatArray = 0.4 * rough / rough.std()
    return surface


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maplets and mapolas of one ground, not registered; not to be changed."""
    workspace = new_workspace(tmp_path_factory.mktemp("right") / "WS", body="Ball")
    mapolas = []
    for number, direction in enumerate(lattice(COUNT)):
        name = f"AA{number:04d}"
        grid = MapletGrid.facing(RADIUS * direction, direction, GSD, HALF)
        noise = np.random.default_rng(1000 + number).normal(size=(2, *grid.shape))
        sigma = np.full(grid.shape, 0.02)
        spc = Maplet(name, grid, terrain(number) + 0.02 * noise[0])
        write_maplet(workspace.root / "MAPFILES" / f"{name}.MAP", spc)
        mapolas.append(
            Mapola(
                name,
                grid,
                terrain(number) + 0.01 * noise[1],
                sigma=sigma,
                count=np.full(grid.shape, 3),
                scan_share={"one" if number % 2 else "two": 1.0},
            )
        )
    write_mapolas(workspace.root / "mapolas", mapolas)
    return workspace.root


def registered(right: Path, target: Path, wrong: dict[str, FloatArray]) -> Path:
    """A registered copy in which some maplets have other heights."""
    shutil.copytree(right, target)
    for name, height in wrong.items():
        path = target / "MAPFILES" / f"{name}.MAP"
        write_maplet(path, replace(read_maplet(path), height=height))
    call("register", target)
    return target


def test_right_maplets_are_fused_without_a_finding(right: Path, tmp_path: Path) -> None:
    folder = registered(right, tmp_path / "WS", {})
    ran = json.loads(call("fuse", folder).stdout)
    assert ran["summary"]["share_both"] > 0.9
    assert ran["summary"]["verdict"] == "accepted"
    assert ran["summary"]["findings"] == []
    assert "remarks" not in ran
    # One maplet of the sample from which the errors of SPC are estimated is twice as rough.
    path = folder / "MAPFILES" / "AA0003.MAP"
    before = read_maplet(path)
    noise = np.random.default_rng(5).normal(size=before.height.shape)
    write_maplet(path, replace(before, height=before.height + 0.02 * noise))
    (remark,) = json.loads(call("fuse", folder).stdout)["remarks"]
    assert (remark["code"], remark["severity"]) == ("spc-errors-changed", "note")
    assert f"all {COUNT} maplets are fused again" in remark["text"]
    assert remark["text"].startswith("the errors of SPC were estimated again (heights ")
    call("register", folder)
    assert (
        "note: after another registration" in CliRunner().invoke(app, ["fuse", str(folder)]).stderr
    )


@pytest.mark.parametrize(
    "alter",
    [lambda: terrain(3)[:, ::-1], lambda: terrain(7), lambda: -terrain(3)],
    ids=["mirrored", "of another maplet", "of the other sign"],
)
def test_a_maplet_that_the_lidar_contradicts_is_named(
    right: Path, tmp_path: Path, alter: Callable[[], FloatArray]
) -> None:
    folder = registered(right, tmp_path / "WS", {"AA0003": alter()})
    result = call("fuse", folder, code=1)
    summary = json.loads(result.stdout)["summary"]
    assert summary["verdict"] == "doubtful"
    (found,) = [one for one in summary["findings"] if one["severity"] != "note"]
    assert found["code"] == "maplet-contradicted"
    assert found["value"] > 2.0 * found["limit"]
    assert f"in 1 of {COUNT} maplets" in found["text"]
    assert "AA0003 (" in found["text"]
    assert "AA0003" in result.stderr
    assert "--accept maplet-contradicted" in result.stderr


def test_contradicted_maplets_are_released_only_if_that_is_accepted(
    right: Path, tmp_path: Path
) -> None:
    """Half of all: the errors of SPC that they raise do not hide them."""
    wrong = {f"AA{number:04d}": terrain(number)[:, ::-1] for number in range(6)}
    folder = registered(right, tmp_path / "WS", wrong)
    summary = json.loads(call("fuse", folder, code=1).stdout)["summary"]
    (found,) = [one for one in summary["findings"] if one["severity"] != "note"]
    assert f"in 6 of {COUNT} maplets" in found["text"]
    assert found["text"].endswith("and 1 more")
    assert "[maplet-contradicted]" in call("release", folder, code=1).stderr
    assert not any((folder / "release").iterdir())
    call("release", folder, "--accept", "maplet-contradicted")
    assert any((folder / "release").iterdir())
