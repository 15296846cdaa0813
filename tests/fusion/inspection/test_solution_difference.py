"""``spcola solution diff``: planted changes of centres, heights, states, shape and constants."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from fusion.inspection import solution_difference
from fusion.pipeline.solutions import MadeBy, making_solution
from fusion.workspace import Workspace, new_workspace
from spcola.camera import Camera, SpcImage
from spcola.control import scaled
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_icq
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.math import Similarity
from spcola.shape.icq import IcqShape, icq_directions

NAMES = [f"AA{number:04d}" for number in range(1, 13)]
SHAPE = IcqShape(250.0 * icq_directions(4))
POLE = {"spin": {"pole_dec_deg": 60.25}}
TURN, SHIFT = np.radians([0.02, -0.03, 0.05]), np.array([3.0, -4.0, 12.0])


def maplet(name: str) -> Maplet:
    away = np.random.default_rng(NAMES.index(name)).normal(size=3)
    away /= np.linalg.norm(away)
    heights = 0.2 * np.sin(np.arange(289.0)).reshape(17, 17)
    return Maplet(name, MapletGrid.facing(250.0 * away, away, 0.5, 8), heights)


def image(name: str) -> SpcImage:
    camera = Camera(100.0, [32.5, 32.5], [[10.0, 0, 0], [0, 10.0, 0]], 64, 64)
    axes = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
    return SpcImage(
        name, "2019 MAR 07 00:00:00.000", camera, 900.0 * axes[2], axes, np.array([0.0, 0.0, 1.0])
    )


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    spc = tmp_path / "spc"
    for name in ("MAPFILES", "SUMFILES", "SHAPEFILES"):
        (spc / name).mkdir(parents=True)
    for name in NAMES:
        write_maplet(spc / "MAPFILES" / f"{name}.MAP", maplet(name))
    for name in ("P1", "P2"):
        write_summary(spc / "SUMFILES" / f"{name}.SUM", image(name))
    write_icq(spc / "SHAPEFILES" / "SHAPE.TXT", SHAPE)
    return new_workspace(tmp_path / "WS", spc=spc)


def difference(workspace: Workspace, *options: object) -> dict[str, Any]:
    words = ["solution", "diff", workspace.root, "imported", "new", "--json", *options]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    content: dict[str, Any] = json.loads(result.stdout)
    return content


def moved(found: Maplet, similarity: Similarity) -> Maplet:
    grid = MapletGrid(
        similarity.apply(found.grid.center), found.grid.axes @ similarity.rotation.T,
        similarity.scale * found.grid.gsd, found.grid.half_size,
    )  # fmt: skip
    return Maplet(found.name, grid, found.height)


def test_planted_changes_are_found(workspace: Workspace, tmp_path: Path) -> None:
    """A similarity of all, a field added to one maplet, a state, the shape, and a pole."""
    similarity = Similarity(
        Rotation.from_rotvec(np.radians([0.3, -0.4, 1.2])).as_matrix(), [1.0, -2.0, 2.0], 1.002
    )
    field = 0.05 * np.random.default_rng(5).normal(size=(17, 17))
    with making_solution(workspace, "new", MadeBy("a test", POLE, {}, {})) as folder:
        for name in NAMES:
            found = moved(maplet(name), similarity)
            if name == NAMES[0]:
                found = found.with_layers(height=found.height + field)
            write_maplet(folder / "MAPFILES" / f"{name}.MAP", found)
        old = image("P1")
        turned = Rotation.from_rotvec(old.axes.T @ TURN).as_matrix()
        state = replace(old, axes=old.axes @ turned.T, scobj=old.scobj - old.axes.T @ SHIFT)
        write_summary(folder / "SUMFILES" / "P1.SUM", state)
        write_icq(folder / "SHAPEFILES" / "SHAPE.TXT", scaled(SHAPE, 1.002))
    content = difference(workspace, "-o", tmp_path / "diff.png")
    assert content["common_scale"] == pytest.approx(1.002, abs=2e-7)
    assert content["common_rotation_deg"] == pytest.approx([0.3, -0.4, 1.2], abs=1e-5)
    middle = np.mean([maplet(name).grid.center for name in NAMES], axis=0)
    shift = similarity.apply(middle) - middle
    assert content["common_shift_m"] == pytest.approx(shift, abs=1e-4)
    lengths = [
        np.linalg.norm(similarity.apply(center) - center)
        for center in (maplet(name).grid.center for name in NAMES)
    ]
    assert content["centers_moved_m"]["p50"] == pytest.approx(np.median(lengths), abs=1e-3)
    assert content["centers_left_over_m"]["p100"] < 1e-3
    assert content["heights_compared"] == len(NAMES)
    assert content["heights_changed_m"]["p100"] == pytest.approx(field.std(), rel=1e-3)
    assert content["heights_changed_m"]["p50"] < 1e-3
    states = solution_difference(workspace, Workspace.open(workspace.root, "new"))
    np.testing.assert_allclose(states.turns, [TURN, [0.0, 0.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(states.positions, [SHIFT, [0.0, 0.0, 0.0]], atol=1e-6)
    assert content["positions_moved_m"]["p100"] == pytest.approx(13.0, abs=1e-6)
    angle = np.degrees(np.linalg.norm(TURN))
    assert content["pointing_turned_deg"]["p100"] == pytest.approx(angle, rel=1e-5)
    assert content["shape_radius_ratio"] == pytest.approx(1.002, rel=1e-5)
    assert content["constants"] == {"spin.pole_dec_deg": [90.0, 60.25]}
    assert (tmp_path / "diff.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("other", ["gsd", "size", "turned"])
def test_heights_of_other_nodes_are_not_compared(workspace: Workspace, other: str) -> None:
    with making_solution(workspace, "new", MadeBy("a test", {}, {}, {})) as folder:
        old = maplet(NAMES[0])
        grid, heights = old.grid, old.height
        if other == "gsd":
            grid = replace(grid, gsd=1.0)
        elif other == "size":
            grid, heights = replace(grid, half_size=4), heights[4:-4, 4:-4]
        else:
            quarter = np.array([grid.axes[1], -grid.axes[0], grid.axes[2]])
            grid = replace(grid, axes=quarter)
        write_maplet(folder / "MAPFILES" / f"{old.name}.MAP", Maplet(old.name, grid, heights))
        write_maplet(folder / "MAPFILES" / "BB0001.MAP", replace(old, name="BB0001"))
    content = difference(workspace)
    assert content["heights_compared"] == len(NAMES) - 1
    assert content["heights_changed_m"]["p100"] < 1e-4
    assert content["only_second"] == ["BB0001"]
