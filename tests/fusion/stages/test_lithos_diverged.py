"""A maplet that a wrong map makes worse keeps its heights, through the real command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import call, called
from photographs import Painted
from scipy import ndimage
from solved_photographs import SIGHTS

from fusion.stages.lithos.fits import Summary
from fusion.stages.lithos.result import content_of
from fusion.workspace import Workspace, new_workspace
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.photometry.photoclinometry import ImageFit, Outcome, PhotoclinometryOptions
from spcola.photometry.photoclinometry.judging import outcome_of
from spcola.photometry.photoclinometry.result import Round
from spcola.photometry.photoclinometry.undetermined_axis import UndeterminedAxis

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
    assert found["reason"].startswith("the residual of brightness rose to ")
    times = float(found["reason"].split()[6])
    assert times > 2.0
    kept = Workspace.open(root, "wrong").maplet_path(NAME)
    assert kept.read_bytes() == workspace.maplet_path(NAME).read_bytes()
    # All that is stated is of what is kept: the true heights, with which all images correlate.
    assert found["residual"] < 0.5 * found["rounds"][-1]["residual"]
    assert found["residual"] == found["residual_start"]
    assert found["correlation"] > 0.85
    assert {one["fit"] for one in found["images"].values()} == {"used"}
    assert found["shift_px"] == 0.0
    findings = {one["code"]: one for one in content["findings"]}
    assert findings["diverged"]["names"] == [NAME]
    do = findings["diverged"]["do"]
    assert do.startswith(f"{NAME}: {found['reason']}; they keep their heights, whose residuals")
    written = json.loads((root / "solutions" / "wrong" / "photoclinometry.json").read_text())
    assert written["maplets"][NAME]["reason"] == found["reason"]
    printed = call(*arguments, "--map", wrong_map, "--as", "printed").stdout
    assert (
        f"residual of brightness {found['residual_start']:.1%} → {found['residual']:.1%}" in printed
    )
    assert f"  diverged: {NAME}; {do}" in printed.splitlines()


def test_of_many_maplets_that_diverged_the_first_three_have_their_reasons():
    names = [f"AA{number:04d}" for number in range(5)]
    start = {"outcome": "diverged", "rounds": [], "light_ratio": None, "constraints": {}}
    found = {
        name: Summary(
            Outcome.DIVERGED, (), {**start, "reason": f"the residual rose to {number}"}
        )
        for number, name in enumerate(names)
    }  # fmt: skip
    (finding,) = content_of(found, {}, [])["findings"]
    assert finding["names"] == names
    reasons = ", ".join(f"{names[k]}: the residual rose to {k}" for k in range(3))
    assert finding["do"].startswith(f"{reasons}; they keep their heights")


def test_a_surface_that_no_image_shows_any_more_has_a_reason_of_its_own():
    lost = [ImageFit.not_seen("I0")]
    rounds = [Round(0.5, 0.1, 0.01, 0.01)]
    ended = outcome_of(
        np.array([0.1]), lost, rounds, 1.0, UndeterminedAxis(), PhotoclinometryOptions()
    )
    assert ended == (Outcome.DIVERGED, "no image shows enough of the surface that was found")
