"""Heights against the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fusion.report.layout import Colour, styled_figure
from fusion.truth import read_truth
from fusion.truth.planted import Planted
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.grids import Maplet, MapletGrid
from spcola.truth.body import TruthBody


def errors_figure(workspace: Workspace, mission: Path) -> Figure:
    """Height errors of SPC and fused maplets, and their errors over the stated sigmas."""
    planted = read_truth(mission)
    body = TruthBody(planted.settings.body)
    names = workspace.fused_names()
    models = {
        "SPC maplets": (Colour.SPC, [workspace.maplet(name) for name in names]),
        "fused maplets": (Colour.FUSED, [workspace.fused(name) for name in names]),
    }
    with styled_figure(9.4, 3.4) as figure:
        left, right = figure.subplots(1, 2)
        for title, (colour, maplets) in models.items():
            found = [height_errors(maplet, body, planted) for maplet in maplets]
            error = np.concatenate([one for one, _ in found])
            pull = np.concatenate([one / sigma for one, sigma in found])
            label = f"{title}, rms {100 * np.sqrt(np.mean(error**2)):.1f} cm"
            _histogram(left, 100 * error, 60.0, colour, label)
            _histogram(right, pull, 4.0, colour, title)
        normal = np.linspace(-4, 4, 201)
        right.plot(
            normal,
            np.exp(-(normal**2) / 2) / np.sqrt(2 * np.pi),
            color=Colour.TEXT,
            lw=1,
            label="normal",
        )
        left.set(xlabel="height error, cm", ylabel="share per cm", title="Errors of heights")
        right.set(xlabel="error / stated sigma", title="Errors in stated sigmas")
        left.legend()
        right.legend()
    return figure


def height_errors(
    maplet: Maplet, body: TruthBody, planted: Planted
) -> tuple[FloatArray, FloatArray]:
    """Errors along Uz and stated sigmas, metres, of all points of a maplet in the SPC frame."""
    to_spc = planted.settings.to_spc
    back, grid = to_spc.inverse(), maplet.grid
    there = MapletGrid(
        back.apply(grid.center), back.turn(grid.axes), grid.gsd * back.scale, grid.half_size
    )
    error = maplet.height - to_spc.scale * body.heights(there)
    known = np.isfinite(error) & np.isfinite(maplet.sigma)
    return error[known], maplet.sigma[known]


def _histogram(panel: Any, values: FloatArray, reach: float, colour: str, label: str) -> None:
    panel.hist(
        np.clip(values, -reach, reach), np.linspace(-reach, reach, 81), density=True,
        histtype="step", color=colour, label=label, lw=1.5,
    )  # fmt: skip
