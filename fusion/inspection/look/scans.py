"""Pictures of lidar files and scans: footprints on the ground, and how they follow in time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.inspection.file_kinds import lidar_format
from fusion.inspection.look.ground import Frame, GroundView, lay_out
from fusion.inspection.look.picture import Picture, set_title
from fusion.inspection.look.shading import limits_of
from fusion.report.figures import graticule
from fusion.report.layout import Colour, styled_figure
from lidar.formats import ScanSample, read_sample
from lidar.formats.clouds import read_las_system
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.navigation import utc_from_et

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 300_000
"""Returns that are drawn at most, evenly chosen among those of the file."""

# Footprints lower than this, over their width, are drawn above the rest.
_SQUARE = 0.6
_HOUR_S, _MINUTE_S = 3600.0, 60.0


def scan_picture(path: Path) -> Picture:
    """Draw the returns of a lidar file of any format, or of a scan of a workspace.

    Above, footprints on the ground coloured by height; below, range and height against time, or
    a histogram of heights where no time is known.

    Raises
    ------
    FormatError
        If the file holds no return, or cannot be read.
    """
    format = lidar_format(path)
    sample = read_sample(path, MOST, format=format)
    scan = sample.scan
    view = lay_out(scan.points, frame=_frame(path, format, scan))
    with styled_figure(*_size(view)) as figure:
        wide = view.kind == "body" or _aspect(view) < _SQUARE
        parts: Any = (
            figure.subfigures(2, 1, height_ratios=[1.75, 1.0])
            if wide
            else figure.subfigures(1, 2, width_ratios=[1.0, 1.0])
        )
        _footprints(parts[0], view, "right" if wide else "bottom")
        if np.isfinite(scan.time).any():
            _against_time(parts[1], scan, view)
        else:
            _histogram(parts[1], view)
        name = scan.name if format == "native" else path.name
        set_title(figure, f"{name}, lidar ({format})", _caption(sample))
    return Picture("lidar", figure, _facts(sample, view, format))


def _frame(path: Path, format: str, scan: Scan) -> Frame:
    """Return what is known of the coordinates: an altimeter's are body-fixed."""
    if format == "las" and read_las_system(path).kind == "projected":
        return "projected"
    return "body-fixed" if np.isfinite(scan.spacecraft).any() else "unknown"


def _aspect(view: GroundView) -> float:
    """Return height over width of the footprints."""
    return float(np.ptp(view.y)) / max(float(np.ptp(view.x)), 1e-9)


def _size(view: GroundView) -> tuple[float, float]:
    """Return width and height of the figure, inches."""
    return (9.4, 8.2) if view.kind == "body" or _aspect(view) < _SQUARE else (12.4, 6.6)


def _footprints(figure: Any, view: GroundView, bar_at: str) -> None:
    """Draw the returns where they lie, coloured by height."""
    panel = figure.subplots()
    low, high = limits_of(view.height, 1.0)
    order = np.argsort(view.height, kind="stable") if len(view.x) < MOST // 2 else slice(None)
    size = float(np.clip(40_000.0 / len(view.x), 0.35, 26.0))
    drawn = panel.scatter(
        view.x[order], view.y[order], c=view.height[order], s=size, cmap="viridis",
        vmin=low, vmax=high, linewidths=0, rasterized=True,
    )  # fmt: skip
    if view.kind == "body":
        graticule(panel)
        panel.set_title("footprints on the body")
    else:
        panel.set(aspect="equal", xlabel=view.labels[0], ylabel=view.labels[1])
        _widen(panel, view)
        panel.grid(visible=True)
        panel.set_title("footprints" if view.kind == "map" else "footprints on the ground")
    bar = figure.colorbar(
        drawn, ax=panel, shrink=0.85, pad=0.01, extend="both", location=bar_at, aspect=26
    )
    bar.set_label(view.labels[2])


def _widen(panel: Any, view: GroundView) -> None:
    """Give a narrow track room at its sides: no side of the panel is below a third of the other."""
    half = np.array([np.ptp(view.x), np.ptp(view.y)]) / 2.0
    half = 1.05 * np.maximum(half, half.max() / 3.0) + 1e-9
    for side, values, reach in zip(("x", "y"), (view.x, view.y), half, strict=True):
        middle = (float(values.min()) + float(values.max())) / 2.0
        panel.set(**{f"{side}lim": (middle - reach, middle + reach)})


def _against_time(figure: Any, scan: Scan, view: GroundView) -> None:
    """Draw height, and range where it is known, against time since the first return."""
    first, last = float(np.nanmin(scan.time)), float(np.nanmax(scan.time))
    seconds, unit = _time_unit(last - first)
    since = (scan.time - first) / seconds
    ranged = np.isfinite(scan.range).any()
    panels = figure.subplots(2 if ranged else 1, 1, sharex=True, squeeze=False).ravel()
    style: dict[str, Any] = {"ls": "none", "marker": ".", "mew": 0, "rasterized": True}
    style["ms"] = float(np.clip(600.0 / np.sqrt(len(since)), 1.2, 6.0))
    if ranged:
        _line(panels[0], since, scan.range, style)
        panels[0].set_ylabel("range, m")
    _line(panels[-1], since, view.height, style)
    panels[-1].set_ylabel(view.labels[3])
    panels[-1].set_xlabel(f"{unit} since {utc_from_et(first)} UTC")
    figure.align_ylabels(panels)


def _line(panel: Any, time: FloatArray, values: FloatArray, style: dict[str, Any]) -> None:
    panel.plot(time, values, color=Colour.SPC, **style)
    low, high = limits_of(values, 0.2)
    pad = 0.08 * (high - low)
    panel.set_ylim(low - pad, high + pad)
    panel.ticklabel_format(axis="y", useOffset=False, style="plain")
    panel.grid(visible=True)


def _histogram(figure: Figure, view: GroundView) -> None:
    """Draw how heights are spread, for a cloud without times."""
    panel = figure.subplots()
    low, high = limits_of(view.height, 0.2)
    panel.hist(
        np.clip(view.height, low, high), np.linspace(low, high, 81).tolist(), color=Colour.SPC
    )
    panel.set(xlabel=view.labels[3], ylabel="returns (those drawn)")
    panel.set_title("heights (no time is known)")
    panel.grid(visible=True, axis="y")


def _time_unit(span: float) -> tuple[float, str]:
    """Return seconds in the unit of time that suits a span, and its name."""
    if span > 3.0 * _HOUR_S:
        return _HOUR_S, "hours"
    return (_MINUTE_S, "minutes") if span > 3.0 * _MINUTE_S else (1.0, "seconds")


def _caption(sample: ScanSample) -> str:
    scan = sample.scan
    drawn = "" if len(scan) == sample.count else f"; one in {sample.count / len(scan):.3g} drawn"
    lost = sum(sample.rejected.values())
    left = f"; {lost} records are no returns" if lost else ""
    return f"{sample.count} returns{drawn}{left}; trajectory: {scan.trajectory}."


def _facts(sample: ScanSample, view: GroundView, format: str) -> dict[str, Any]:
    """Return what was drawn, for ``--json``."""
    scan = sample.scan
    times = scan.time[np.isfinite(scan.time)]
    return {
        "name": scan.name,
        "format": format,
        "returns": sample.count,
        "drawn": len(scan),
        "rejected": sample.rejected,
        "layout": view.kind,
        "lowest_m": scan.points.min(axis=0),
        "highest_m": scan.points.max(axis=0),
        "first_utc": utc_from_et(float(times.min())) if len(times) else None,
        "last_utc": utc_from_et(float(times.max())) if len(times) else None,
    }
