"""A wall on the next maplet: its shadow is in renderings as it was in the solution."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import called
from photographs import Painted
from solved_workspace import SIGHTS

from fusion.report.photoclinometry import image_strip, strip_png
from fusion.report.photoclinometry.gather import gather_solved, solved_inputs
from fusion.service.views.photoclinometry import solved_etag, solved_picture
from fusion.workspace import Workspace, new_workspace
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.photometry.secondary_light import name_in_shade

NAME, WALL, LOW = "AA0001", "AA0002", "LOW"
GSD, HALF = 0.5, 20
# Elevation of the Sun, radians; height and near side of the wall, metres along Ux.
ELEVATION, TALL, NEAR = 0.35, 4.0, -14.0
SHADOW_ENDS = NEAR + TALL / np.tan(ELEVATION)
# Codes of the palette of strips.
UNKNOWN, BLACK, BLUE = 0, 1, 128


class Gentle(Painted):
    """Ground so low that shadows on it end where they do on a plane."""

    def height(self, x, y):
        return 0.1 * super().height(x, y)

    def slopes(self, x, y):
        return tuple(0.1 * part for part in super().slopes(x, y))


def write_wall(path: Path, own: MapletGrid, tall: float) -> None:
    """Write a maplet 20 m along −Ux, level, with a wall of 2 m across."""
    grid = MapletGrid(own.center - 20.0 * own.ux, own.axes, GSD, HALF)
    x = grid.offsets * GSD - 20.0
    heights = np.zeros(grid.shape)
    heights[:, (x <= NEAR) & (x >= NEAR - 2.0)] = tall
    path.unlink(missing_ok=True)
    write_maplet(path, Maplet(WALL, grid, heights))


@pytest.fixture(scope="module")
def walled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Workspace, dict[str, Any]]:
    """The solution `images`, and what ``spc lithos`` printed."""
    root = tmp_path_factory.mktemp("walled") / "WS"
    made = new_workspace(root, body="Walled")
    ground = Gentle(MapletGrid.facing(np.array([80.0, 20.0, 10.0]), [0.9, 0.3, 0.2], GSD, HALF))
    own = ground.grid
    write_maplet(made.maplet_path(NAME), Maplet(NAME, own, ground.heights()))
    write_wall(made.maplet_path(WALL), own, TALL)
    low = [-np.cos(ELEVATION), 0.0, np.sin(ELEVATION)]
    sights = {f"I{k}": sight for k, sight in enumerate(SIGHTS[:4])} | {LOW: ([0.0, 0.0, 1.0], low)}
    for name, (toward, sun) in sights.items():
        image = ground.photograph(name, toward, sun, size=64)
        pixels = image.pixels.astype(float)
        if name == LOW:
            # A tenth of the light comes from elsewhere: no threshold takes it for a shadow.
            line, sample = np.indices(pixels.shape) - 31.5
            on_ground = (sample[..., None] * image.axes[0] + line[..., None] * image.axes[1]) * 0.5
            pixels[on_ground @ own.ux < SHADOW_ENDS] *= 0.1
        write_image_data(made.exposure_path(name), np.rint(pixels).astype(np.uint16))
        write_summary(made.image_path(name), image)
    given = ("--only", NAME, "--constraint", "none", "--photometry", "lambert", "--as", "images")
    content = called("spc", "lithos", root, *given)
    return Workspace.open(root, "images"), content


def test_the_shadow_is_in_rendering_and_residual(walled: tuple[Workspace, dict[str, Any]]) -> None:
    workspace, content = walled
    one = content["maplets"][NAME]
    assert (one["around"], one["images"][LOW]["fit"]) == ([WALL], "used")
    maplet = workspace.maplet(NAME)
    (shown,) = gather_solved(workspace).shown
    size = maplet.grid.size
    # Rows run along Ux; points at the ends of the shadow and at the edges may be either.
    x = maplet.grid.offsets * GSD
    dark, lit = ((x > -9.0) & (x < SHADOW_ENDS - 1.5), (x > SHADOW_ENDS + 1.5) & (x < 9.0))
    with_wall, without = shown.strips[LOW], image_strip(workspace, content, maplet, LOW, None)
    rendering, residual = (
        [codes[:, k * (size + 2) :][:, 5 : size - 5] for codes in (with_wall, without)]
        for k in (1, 2)
    )
    assert np.mean(rendering[0][dark] == BLACK) > 0.95
    assert np.mean(rendering[1][dark] == BLACK) < 0.05
    # The solver did not have what would be a residual of −0.9 there.
    assert np.mean(residual[0][dark] == UNKNOWN) > 0.95
    assert np.mean(residual[1][dark] == BLUE) > 0.95
    assert np.mean(residual[0][lit] == UNKNOWN) < 0.05
    assert solved_picture(workspace, NAME, LOW) == strip_png(with_wall)


def test_pictures_change_with_the_maplets_around(
    walled: tuple[Workspace, dict[str, Any]], tmp_path: Path
) -> None:
    root = tmp_path / "WS"
    shutil.copytree(walled[0].root, root, symlinks=True)
    workspace = Workspace.open(root, "images")
    given = ("report", root, "--solution", "images")
    assert [called(*given)["state"] for _ in range(2)] == ["ran", "up to date"]
    tag, picture = solved_etag(workspace, NAME, LOW), solved_picture(workspace, NAME, LOW)
    # The solution has the wall as a file of its own: what counts is that of its parent.
    write_wall(root / "MAPFILES" / f"{WALL}.MAP", workspace.maplet(NAME).grid, 0.0)
    assert solved_etag(workspace, NAME, LOW) != tag
    assert solved_picture(workspace, NAME, LOW) != picture
    assert called(*given)["state"] == "ran"


def test_an_image_in_the_shade_has_the_files_of_its_image(
    walled: tuple[Workspace, dict[str, Any]], tmp_path: Path
) -> None:
    root = tmp_path / "WS"
    shutil.copytree(walled[0].root, root, symlinks=True)
    workspace = Workspace.open(root, "images")
    content = workspace.read_json("photoclinometry.json")
    images = content["maplets"][NAME]["images"]
    content["maplets"][NAME]["images"] = {name_in_shade(LOW): images[LOW]}
    workspace.photoclinometry_path.unlink()
    workspace.write_json("photoclinometry.json", content)
    files = solved_inputs(workspace)
    assert {workspace.image_path(LOW), workspace.exposure_path(LOW)} <= set(files)
