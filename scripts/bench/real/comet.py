"""67P: NavCam frames, the encoding of their brightness, and landmarks of an SPC solution."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fusion.workspace import Workspace
from real.printed import print_left_out
from real.run import Run, exposed
from real.steps import print_photometry, print_states, print_tiles
from spcola.camera import project_image
from spcola.formats.solution import read_landmark, read_summary
from spcola.shape import RayCaster

NAVCAM = """[NAVCAM]
focal_length_mm = 152.5
center = [256.5, 256.5]
k_matrix = [[38.448288, 0.0, 0.0], [0.0, 38.448288, 0.0]]
size = [512, 512]
"""
# What the frames of 67P fit best: see --gammas.
GAMMA = 2
# One of so many frames is left out.
TENTH = 10
# Of the maplets, metres.
GSD = 18


def comet(run: Run) -> None:
    """63 frames, and 7 that are left out."""
    print("67P, NavCam")
    folder = run.data / "rosetta_67p" / "navcam"
    frames = sorted(folder.glob("images/*.png"))[:: run.every]
    kept = [path for k, path in enumerate(frames) if k % TENTH]
    root, apart = (
        _workspace(run, run.work / name, some, GAMMA)
        for name, some in (("67p", kept), ("67p-left-out", frames[::TENTH]))
    )
    for each in (root, apart):
        print_states(run.register(each))
        run.use(each, "registered")
    print_tiles(run.tile(root, GSD))
    run.use(root, "tiles")
    setting = print_photometry(run.spcola("photometry", "fit", root))
    solved = run.solve(root, "--photometry", setting)
    print_left_out(run, "67P", setting, solved, exposed(Workspace.open(apart)))


def encodings(run: Run, gammas: Sequence[float]) -> None:
    """Print which encoding of the brightness fits the frames."""
    print("67P, encoding of the brightness: residual of the best function, over gamma")
    frames = sorted((run.data / "rosetta_67p" / "navcam").glob("images/*.png"))[::4]
    for gamma in gammas:
        root = _workspace(run, run.work / f"gamma-{gamma:g}", frames, gamma)
        run.register(root)
        run.use(root, "registered")
        run.tile(root, GSD)
        run.use(root, "tiles")
        functions = ("--function", "akimov", "--function", "minnaert")
        (found,) = run.spcola("photometry", "fit", root, *functions)["filters"]
        best = min(one["residual_std"] for one in found["functions"])
        print(f"  gamma {gamma:3.1f}: {best:.2%} / gamma = {best / gamma:.2%}")


def landmarks(run: Run) -> None:
    """The .SUM and .LMK files: reprojection, and the shape of the NavCam frames there."""
    print("67P, landmarks of an SPC solution")
    folder = run.data / "rosetta_67p"
    image = read_summary(next(folder.glob("*.SUM")))
    places = {one.name: (one.pixel, one.line) for one in image.landmarks}
    workspace = run.work / "landmarks"
    shape = folder / "navcam" / "67p-4k.obj"
    run.spcola("init", workspace, "--body", "67P", "--shape", shape, parallel=False)
    caster = RayCaster(Workspace.open(workspace).shape())
    for path in sorted(folder.glob("*.LMK")):
        grid = read_landmark(path).grid
        off = np.array(places[path.stem]) - np.array(project_image(image, grid.center))
        hit = caster.cast(grid.center + 500.0 * grid.uz, -grid.uz[None])
        above = 500.0 - float(hit.distance[0]) if hit.hit[0] else float("nan")
        print(
            f"  {path.stem}: observed less predicted {off[0]:+.2f}, {off[1]:+.2f} px; the shape "
            f"lies {above:+.0f} m above it, {grid.center.round(0)}"
        )


def _workspace(run: Run, root: Path, frames: Sequence[Path], gamma: float) -> Path:
    """Make a workspace of the shape and of frames with a gamma."""
    folder = run.data / "rosetta_67p" / "navcam"
    camera = run.work / "navcam.toml"
    camera.write_text(NAVCAM, encoding="utf-8")
    run.spcola("init", root, "--body", "67P", "--shape", folder / "67p-4k.obj", parallel=False)
    run.spcola(
        "images", root, *frames, "--poses", folder / "poses.csv", "--camera", camera,
        "--letter", "N", "--gamma", gamma,
    )  # fmt: skip
    return root
