"""Whether maplets of a solution contain the lidar, by the records of solutions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from command_line import call

from fusion.pipeline.solutions import MadeBy, making_solution
from fusion.pipeline.solutions.lidar_content import LidarContent
from fusion.workspace import Workspace, new_workspace


def solved(
    *constraints: str, start: str = "maplet", only: tuple[str, ...] = (), kept: int = 0
) -> dict[str, Any]:
    """Facts of a solution whose maplets come from images."""
    outcomes = {"converged": 2} | ({"diverged": kept} if kept else {})
    options = {"start": start, "only": list(only), "within": None, "constraints": [*constraints]}
    return {"lithos": options, "outcomes": outcomes}


TILED: dict[str, Any] = {"tiling": {"gsd_m": 0.5}}
LIDAR, MAPOLAS = solved("shape", "overlaps", "returns"), {"albedo": {"of": "mapolas"}}
ANEW = solved("shape", start="shape")


def test_an_exported_solution_states_it_and_its_workspace_keeps_it(tmp_path: Path) -> None:
    root = new_workspace(tmp_path / "WS").root
    with making_solution(Workspace.open(root), "s1", MadeBy("a test", {}, LIDAR, {})):
        pass
    with making_solution(Workspace.open(root, "s1"), "s2", MadeBy("another", {}, TILED, {})):
        pass
    call("solution", "export", root, "s2", tmp_path / "out")
    call("init", tmp_path / "again", "--spc", tmp_path / "out")
    # An SPC folder may become a workspace as it is.
    call("init", tmp_path / "out", "--spc", tmp_path / "out")
    for name in ("again", "out"):
        workspace = Workspace.open(tmp_path / name)
        found = LidarContent.of(workspace)
        assert found == ("s1", "a test", "")
        assert "the workspace from which it was exported" in found.obstacle(workspace, [])
        assert LidarContent.of(Workspace.open(root)) is None
    call("solution", "export", root, "imported", tmp_path / "plain")
    call("init", tmp_path / "free", "--spc", tmp_path / "plain")
    assert LidarContent.of(Workspace.open(tmp_path / "free")) is None


@pytest.mark.parametrize(
    ("chain", "first"),
    [
        ([], None),
        ([TILED, solved("shape", "overlaps")], None),
        ([LIDAR], "s1"),
        ([solved("lidar")], "s1"),
        ([MAPOLAS], "s1"),
        ([{"albedo": {"of": "maplets"}}], None),
        ([TILED, LIDAR, TILED, LIDAR], "s2"),
        # Heights of the parent are start or constraints, or stay in some maplets.
        ([LIDAR, solved("shape")], "s1"),
        ([LIDAR, solved("coarser", start="shape")], "s1"),
        ([LIDAR, solved("shape", start="shape", only=("AA0001",))], "s1"),
        ([LIDAR, solved("shape", start="shape", kept=1)], "s1"),
        ([LIDAR, ANEW], None),
        ([LIDAR, ANEW, TILED], None),
        ([LIDAR, ANEW, solved("returns")], "s3"),
    ],
)
def test_maplets_contain_the_lidar_until_all_are_solved_anew(
    tmp_path: Path, chain: list[dict[str, Any]], first: str | None
) -> None:
    workspace = new_workspace(tmp_path / "WS")
    for number, facts in enumerate(chain, start=1):
        with making_solution(workspace, f"s{number}", MadeBy("a test", {}, facts, {})):
            pass
        workspace = Workspace.open(workspace.root, f"s{number}")
    found = LidarContent.of(workspace)
    if first is None:
        assert found is None
        return
    before = "imported" if first == "s1" else f"s{int(first[1:]) - 1}"
    assert found == (first, "a test", before)
    assert f"solution use {workspace.root} {before}" in found.obstacle(workspace, [])
    assert found.obstacle(workspace, ["lidar-counted-twice"]) == ""
