"""A maplet that a wrong map makes worse keeps its heights, through the real command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import call, called
from photographs import Painted
from scipy import ndimage
from solved_photographs import SIGHTS

from fusion.workspace import Workspace, new_workspace
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid

NAME = "AA0001"


@pytest.fixture(scope="module")
def ground():
    return Painted(MapletGrid.facing([80.0, 20.0, 10.0], [0.9, 0.3, 0.2], 0.5, 20))


@pytest.fixture(scope="module")
def workspace(tmp_path_factory, ground):
    """One maplet that is the truth, and five images of it."""
    made = new_workspace(tmp_path_factory.mktemp("diverged") / "WS", body="Waves")
    write_maplet(made.maplet_path(NAME), Maplet(NAME, ground.grid, ground.heights()))
    for k, (toward, sun) in enumerate(SIGHTS[:5]):
        image = ground.photograph(f"I{k}", toward, sun, size=64)
        write_image_data(made.exposure_path(image.name), image.pixels)
        write_summary(made.image_path(image.name), image)
    return made


@pytest.fixture(scope="module")
def wrong_map(tmp_path_factory, ground):
    """Heights that err by 0.5 m, with a sigma of 0.01 m."""
    error = ndimage.gaussian_filter(np.random.default_rng(0).normal(size=ground.grid.shape), 1.5)
    height = ground.heights() + 0.5 * error / error.std()
    path = tmp_path_factory.mktemp("map") / "W.MAP"
    sigma = np.full(ground.grid.shape, 0.01)
    write_maplet(path, Maplet("WRONG", ground.grid, height, sigma=sigma), sigma_companion=True)
    return path


def test_a_maplet_that_diverges_keeps_its_bytes_and_is_named_with_the_reason(workspace, wrong_map):
    root = workspace.root
    arguments = (
        "spc", "lithos", root, "--constraint", "none", "--photometry", "lambert",
    )  # fmt: skip
    right = called(*arguments, "--as", "right")
    assert right["maplets"][NAME]["outcome"] == "converged"
    content = called(*arguments, "--map", wrong_map, "--as", "wrong")
    found = content["maplets"][NAME]
    assert found["outcome"] == "diverged"
    assert found["reason"].startswith("the residual of brightness is ")
    times = float(found["reason"].split()[5])
    assert times > 2.0
    kept = Workspace.open(root, "wrong").maplet_path(NAME)
    assert kept.read_bytes() == workspace.maplet_path(NAME).read_bytes()
    findings = {one["code"]: one for one in content["findings"]}
    assert findings["diverged"]["names"] == [NAME]
    assert "keep their heights" in findings["diverged"]["do"]
    written = json.loads((root / "solutions" / "wrong" / "photoclinometry.json").read_text())
    assert written["maplets"][NAME]["reason"] == found["reason"]
    printed = call(*arguments, "--map", wrong_map, "--as", "printed").stdout
    assert (
        f"residual of brightness {found['residual_start']:.1%} → {found['residual']:.1%}" in printed
    )
    assert any("diverged" in line and NAME in line for line in printed.splitlines())
