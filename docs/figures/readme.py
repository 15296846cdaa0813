"""Draws the picture of the README: three surfaces of a pole that is never lit.

spcola truth make mission --preset pole --seed 1 --set passes.count=9
spcola init ws --spc mission/spc --body Truth
spcola import ws mission/lidar/*
spcola run ws
PYTHONPATH=docs python docs/figures/readme.py ws docs/_static/surfaces.png
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

from figures.surfaces import both, draw_surfaces
from PIL import Image

from fusion.report.layout import figure_bytes, styled_figure
from fusion.workspace import Workspace

MAPLET = "TR0064"
COLOURS = 96


def main(folder: str, target: str) -> None:
    """Draw the maplet at the pole."""
    workspace = Workspace.open(Path(folder))
    fused = workspace.fused(MAPLET)
    with styled_figure(8.4, 3.25) as figure:
        draw_surfaces(figure.subplots(1, 3), fused, *both(workspace, fused))
    picture = Image.open(io.BytesIO(figure_bytes(figure, "png", dpi=100)))
    picture.convert("RGB").quantize(COLOURS).save(target, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
