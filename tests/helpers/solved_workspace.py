"""A workspace with a maplet that is solved from photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from command_line import called
from photographs import Painted

from fusion.workspace import new_workspace
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid

MAPLET, REVERSED, FAR = "AA0001", "I4", "AA0002"
"""Names: of the maplet, of the image whose Sun is stated on the wrong side, and of a maplet on the
other side of the body, which no image shows."""
NOISE = 0.01
"""Relative, of the photographs."""
# Directions to camera and Sun, along south, east and up.
SIGHTS = [
    ([0.3, 0.0, 1.0], [0.7, 0.1, 0.8]),
    ([-0.4, 0.2, 1.0], [-0.5, 0.4, 0.8]),
    ([0.0, 0.4, 1.0], [0.1, 0.7, 0.8]),
    ([0.1, -0.4, 1.0], [0.2, -0.6, 0.8]),
    ([0.4, 0.4, 1.0], [0.5, -0.5, 0.8]),
]


def solved_workspace(
    root: Path, sights: Sequence[tuple[list[float], list[float]]] = SIGHTS
) -> dict[str, Any]:
    """Make it, with the solution `images` in use; return what ``spc lithos`` printed."""
    made = new_workspace(root, body="Waves")
    place = np.array([80.0, 20.0, 10.0])
    ground = Painted(MapletGrid.facing(place, [0.9, 0.3, 0.2], 0.5, 20))
    grids = {MAPLET: ground.grid, FAR: MapletGrid.facing(-place, [-0.9, -0.3, -0.2], 0.5, 20)}
    for name, grid in grids.items():
        write_maplet(made.maplet_path(name), Maplet(name, grid, np.zeros(grid.shape)))
    rng = np.random.default_rng(5)
    for number, (toward, sun) in enumerate(sights):
        image = ground.photograph(f"I{number}", toward, sun, size=64)
        assert image.pixels is not None
        noisy = image.pixels * (1.0 + NOISE * rng.normal(size=image.pixels.shape))
        write_image_data(made.exposure_path(image.name), np.rint(noisy).astype(np.uint16))
        if image.name == REVERSED:
            up = ground.grid.uz
            image = replace(image, sun=2.0 * (image.sun @ up) * up - image.sun)
        write_summary(made.image_path(image.name), image)
    content: dict[str, Any] = called(
        "spc", "lithos", root, "--constraint", "none", "--photometry", "lambert", "--as", "images"
    )
    called("solution", "use", root, "images")
    return content
