"""Picture of a workspace: where maplets, lidar and mapolas lie, and what the stages found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.inspection.look.numbers import millionths
from fusion.inspection.look.picture import Picture, set_title
from fusion.inspection.workspace_facts import describe_workspace
from fusion.pipeline.catalog import read_records
from fusion.report import gather_coverage
from fusion.report.figures import draw_coverage, graticule
from fusion.report.layout import Colour, styled_figure
from fusion.report.maplets import hillshade
from fusion.workspace import Workspace
from lidar.scan_store import ScanStore
from spcola.arrays import FloatArray
from spcola.errors import SpcolaError
from spcola.math import lon_lat_deg
from spcola.shape import RayCaster

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Returns that are drawn, and columns of the shape's map.
_RETURNS, _COLUMNS = 30_000, 360
_STATES = {"up to date": Colour.FUSED, "due": Colour.LIDAR}
_VERDICTS = {"accepted": Colour.FUSED, "doubtful": Colour.LIDAR, "refused": Colour.REJECTED}


def workspace_picture(workspace: Workspace) -> Picture:
    """Draw a workspace: a map of what it holds, the state of its stages, and its results.

    Raises
    ------
    SpcolaError
        If its settings are wrong, or a folder of it cannot be read.
    """
    facts = describe_workspace(workspace)
    returns = _returns(workspace)
    with styled_figure(11.0, 8.6) as figure:
        parts: Any = figure.subfigures(2, 1, height_ratios=[1.75, 1.0])
        _map(parts[0], workspace, returns)
        stages, results = parts[1].subplots(1, 2, width_ratios=[1.0, 1.15])
        verdicts = _verdicts(workspace)
        _stage_list(stages, facts["stages"], verdicts)
        _result_list(results, workspace, facts)
        set_title(figure, f"Workspace {workspace.root.resolve().name}, body: {facts['body']}")
    shown = {key: facts[key] for key in _FACTS}
    return Picture("workspace", figure, {**shown, "verdicts": verdicts})


_FACTS = (
    "body", "maplets", "landmarks", "images", "shape", "scans", "returns", "mapolas", "fused",
    "stages", "problems",
)  # fmt: skip


def _returns(workspace: Workspace) -> FloatArray:
    """Return some returns (N, 3), metres, evenly chosen among all scans."""
    paths = workspace.scan_paths()
    if not paths:
        return np.empty((0, 3))
    return ScanStore(paths).spread(_RETURNS)


def _map(figure: Figure, workspace: Workspace, returns: FloatArray) -> None:
    """Draw the shape's relief, the returns, and the maplets coloured by what the lidar covers."""
    panel = figure.subplots()
    if workspace.has_shape():
        try:
            shade = _shape_map(workspace)
        except SpcolaError as error:
            panel.text(0.5, 1.01, f"shape: {error.what}", transform=panel.transAxes, ha="center")
        else:
            panel.imshow(shade, cmap="gray", vmin=-0.6, vmax=1.0, extent=(0, 360, -90, 90),
                         alpha=0.55, interpolation="bilinear")  # fmt: skip
    if len(returns):
        longitude, latitude = lon_lat_deg(returns)
        panel.scatter(longitude, latitude, s=1.4, color=Colour.SPC, alpha=0.5, linewidths=0,
                      rasterized=True)  # fmt: skip
        panel.scatter([], [], s=14, color=Colour.SPC, label="lidar returns (some of them)")
    coverage = gather_coverage(workspace)
    if coverage is None:
        graticule(panel)
        text = "no maplets and no mapolas yet"
        panel.text(0.99, 1.01, text, transform=panel.transAxes, ha="right", va="bottom")
    else:
        draw_coverage(figure, panel, coverage)
    panel.set_title("footprints of the lidar, maplets and mapolas")


def _shape_map(workspace: Workspace) -> FloatArray:
    """Return the shaded relief (rows from north to south) of the shape over the whole body."""
    mesh = workspace.shape()
    step = 360.0 / _COLUMNS
    longitude = np.radians((np.arange(_COLUMNS) + 0.5) * step)
    latitude = np.radians(90.0 - (np.arange(_COLUMNS // 2) + 0.5) * step)
    lon, lat = np.meshgrid(longitude, latitude)
    outward = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    ways = outward.reshape(-1, 3)
    far = 3.0 * float(np.linalg.norm(mesh.vertices, axis=1).max())
    hits = RayCaster(mesh).cast(far * ways, -ways)
    radius = (far - hits.distance).reshape(lon.shape)
    return hillshade(radius.T, float(np.radians(step)) * mesh.mean_radius)


def _verdicts(workspace: Workspace) -> dict[str, str]:
    """Return the verdicts of the stages that have one, as their last runs recorded them."""
    records = {record.stage: record.summary for record in read_records(workspace)}
    return {name: str(of["verdict"]) for name, of in records.items() if "verdict" in of}


def _stage_list(panel: Any, states: Mapping[str, str], verdicts: Mapping[str, str]) -> None:
    """Write the stages in their order, with a mark for the state and the verdict."""
    panel.set_title("stages")
    panel.axis("off")
    panel.set(xlim=(0, 1), ylim=(len(states) - 0.4, -0.6))
    for row, (name, state) in enumerate(states.items()):
        panel.plot(0.03, row, "o", ms=8, color=_STATES.get(state, Colour.GREY), clip_on=False)
        panel.text(0.08, row, name, va="center", weight="bold")
        panel.text(0.36, row, state.partition(":")[0], va="center", color=Colour.TEXT)
        verdict = verdicts.get(name, "")
        panel.text(
            0.68,
            row,
            verdict,
            va="center",
            color=_VERDICTS.get(verdict, Colour.TEXT),
            weight="bold",
        )


def _result_list(panel: Any, workspace: Workspace, facts: Mapping[str, Any]) -> None:
    """Write what the workspace holds, and the numbers that were found."""
    panel.set_title("what it holds")
    panel.axis("off")
    lines = [
        f"{facts['images']} images, {facts['landmarks']} landmarks, {facts['maplets']} maplets",
        f"shape: {facts['shape'] or 'none'}",
        f"{facts['scans']} scans with {facts['returns']} returns",
        f"{facts['mapolas']} mapolas, {facts['fused']} fused maplets",
        *_numbers(workspace),
        *(f"problem: {text[:90]}" for text in facts["problems"][:2]),
    ]
    for row, line in enumerate(lines):
        panel.text(0.0, 0.97 - 0.105 * row, line, transform=panel.transAxes, va="top")


def _numbers(workspace: Workspace) -> list[str]:
    """Return the scale of the registration and epsilon, where they are known."""
    found = []
    for path, label, key, offset in (
        (workspace.registration_path, "registration: scale − 1", "scale", 1.0),
        (workspace.scale_path, "scale: ε", "epsilon", 0.0),
    ):
        content = workspace.find_json(path.name) or {}
        value, sigma = content.get(key), content.get(f"{key}_sigma")
        if value is not None:
            found.append(f"{label} = {millionths(value - offset, sigma)}")
    return found
