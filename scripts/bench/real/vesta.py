"""Vesta: frames of Dawn FC2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fusion.workspace import Workspace
from real.places import latitude_longitude
from real.printed import print_left_out
from real.run import Run, exposed
from real.steps import print_states, print_tiles
from spcola.camera import SpcImage
from spcola.shape import RayCaster


def vesta(run: Run) -> None:
    """Three frames, and one that is left out."""
    print("Vesta, Dawn FC2")
    folder = run.data / "vesta"
    frames = sorted(folder.glob("images/*.png"))
    left_out = frames[1]
    root, apart = run.work / "vesta", run.work / "vesta-left-out"
    for each, some in ((root, [f for f in frames if f != left_out]), (apart, [left_out])):
        shape = folder / "vesta_5002.ply"
        run.spcola("init", each, "--body", "Vesta", "--shape", shape, parallel=False)
        run.spcola(
            "images", each, *some, "--states", "colmap", "--model", folder, "--times",
            folder / "frames.csv",
        )  # fmt: skip
        print_states(run.register(each))
        run.use(each, "registered")
    first = Workspace.open(root)
    latitude, longitude = _lit_place(first.images(), RayCaster(first.shape()))
    print_tiles(run.tile(root, 380, f"{latitude:.2f},{longitude:.2f},70000"))
    run.use(root, "tiles")
    solved = run.solve(root)
    print_left_out(run, "Vesta", solved.photometry, solved, exposed(Workspace.open(apart)))


def _lit_place(images: Sequence[SpcImage], caster: RayCaster) -> tuple[float, float]:
    """Return where the ground is that all images see in good light, degrees."""
    toward = sum(image.position / np.linalg.norm(image.position) + image.sun for image in images)
    toward = toward / np.linalg.norm(toward)
    hit = caster.cast(3.0 * caster.radius * toward, -toward[None])
    return latitude_longitude(hit.points[0])
