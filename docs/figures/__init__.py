"""Figures of the explanation, drawn from the workspace and the mission of the tutorial."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from figures.density import density_figure
from figures.errors import errors_figure
from figures.mapola import mapola_figure
from figures.scans import scans_figure
from figures.surfaces import bigmaps_figure, fused_figure
from matplotlib.figure import Figure

from fusion.report.figures import registration_figure, scale_figure
from fusion.workspace import Workspace


def registration(tutorial: Path) -> Figure:
    """Residuals of the registration, as the report shows them."""
    return registration_figure(_workspace(tutorial).read_json("registration.json"))


def scale(tutorial: Path) -> Figure:
    """ε of each pair of bigmaps, as the report shows it."""
    return scale_figure(_workspace(tutorial).read_json("scale.json"))


def _workspace(tutorial: Path) -> Workspace:
    return Workspace.open(tutorial / "ws")


def _of_workspace(draw: Callable[[Workspace], Figure]) -> Callable[[Path], Figure]:
    return lambda tutorial: draw(_workspace(tutorial))


def _of_mission(draw: Callable[[Workspace, Path], Figure]) -> Callable[[Path], Figure]:
    return lambda tutorial: draw(_workspace(tutorial), tutorial / "mission")


FIGURES: Mapping[str, Callable[[Path], Any]] = {
    "scans": _of_workspace(scans_figure),
    "mapola": _of_workspace(mapola_figure),
    "registration": registration,
    "fused": _of_workspace(fused_figure),
    "bigmaps": _of_workspace(bigmaps_figure),
    "scale": scale,
    "errors": _of_mission(errors_figure),
    "density": lambda _: density_figure(),
}
"""By the name of its file, what draws each figure from the tutorial's folder."""
