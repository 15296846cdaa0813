"""Figures of one model: map and histograms of its errors, and examples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.report.figures import graticule
from fusion.report.layout import Colour, styled_figure
from fusion.report.maplets import (
    draw_differences,
    grid_image,
    hillshade,
    label_panels,
    symmetric_limit,
)
from fusion.truth.assessment.patches import PatchErrors
from fusion.truth.assessment.regions import PointErrors
from spcola.arrays import FloatArray
from spcola.math import lon_lat_deg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CELL_DEG = 2.0
_PULLS = np.linspace(-5.0, 5.0, 81)


def error_map(errors: PointErrors, cell_deg: float = _CELL_DEG) -> FloatArray:
    """Return the mean height error (90°/c·2, 360°/c), metres, in cells of longitude and latitude.

    South first, longitudes from 0°; NaN where there are no points.
    """
    longitude, latitude = lon_lat_deg(errors.direction)
    rows, columns = round(180.0 / cell_deg), round(360.0 / cell_deg)
    row = np.clip(((latitude + 90.0) / cell_deg).astype(np.int64), 0, rows - 1)
    column = np.clip((longitude / cell_deg).astype(np.int64), 0, columns - 1)
    label = row * columns + column
    count = np.bincount(label, minlength=rows * columns)
    total = np.bincount(label, errors.height.astype(np.float64), minlength=rows * columns)
    mean = np.full(rows * columns, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    return mean.reshape(rows, columns)


def errors_figure(errors: PointErrors, tint: str) -> Figure:
    """Map of the height errors, their histogram, and that of error over stated sigma."""
    import matplotlib as mpl  # noqa: PLC0415

    mean = error_map(errors)
    reach = symmetric_limit(errors.height)
    with styled_figure(9.4, 6.2) as figure:
        parts: Any = figure.subfigures(2, 1, height_ratios=[1.7, 1.0])
        panel = parts[0].subplots()
        drawn = panel.imshow(
            np.ma.masked_invalid(mean), origin="lower", extent=(0, 360, -90, 90),
            cmap=mpl.colormaps["RdBu_r"].with_extremes(bad=Colour.MISSING),
            vmin=-reach, vmax=reach, interpolation="nearest",
        )  # fmt: skip
        graticule(panel)
        bar = parts[0].colorbar(drawn, ax=panel, shrink=0.9, extend="both", pad=0.01)
        bar.set_label("mean height error, m")
        left, right = parts[1].subplots(1, 2)
        _histogram(left, errors.height, reach, tint)
        _pull_histogram(right, errors, tint)
    return figure


def _histogram(panel: Any, error: FloatArray, reach: float, tint: str) -> None:
    """Draw the histogram of height errors; the outermost bins include all beyond."""
    edges = np.linspace(-2.0 * reach, 2.0 * reach, 81)
    panel.hist(np.clip(error, edges[0], edges[-1]), edges, density=True, color=tint)
    panel.axvline(0.0, color=Colour.TEXT, lw=0.8)
    panel.set(xlabel="height error, m", ylabel="density, 1/m", yscale="log")
    mean, rms = float(np.mean(error)), float(np.sqrt(np.mean(error**2)))
    panel.set_title(f"mean {mean:+.3f} m, rms {rms:.3f} m".replace("-", "−"))
    panel.grid(visible=True, axis="y")


def _pull_histogram(panel: Any, errors: PointErrors, tint: str) -> None:
    """Draw the histogram of error over sigma, with that of correct sigmas."""
    stated = errors.sigma > 0
    if not stated.any():
        panel.axis("off")
        panel.text(0.5, 0.5, "no sigma is stated", ha="center", transform=panel.transAxes)
        return
    pull = errors.height[stated] / errors.sigma[stated]
    panel.hist(np.clip(pull, -5.0, 5.0), _PULLS, density=True, color=tint)
    normal = np.exp(-0.5 * _PULLS**2) / np.sqrt(2.0 * np.pi)
    panel.plot(_PULLS, normal, color=Colour.TEXT, lw=1.2, ls="--", label="if sigmas are correct")
    panel.set(xlabel="height error / stated sigma", ylabel="density", xlim=(-5, 5))
    panel.set_title(f"standard deviation {float(np.std(pull)):.2f}")
    panel.legend(loc="upper left")
    panel.grid(visible=True, axis="y")


def examples_figure(examples: Sequence[PatchErrors]) -> Figure:
    """Truth, model and difference of some patches, one row each."""
    with styled_figure(9.4, 3.05 * len(examples)) as figure:
        panels = figure.subplots(len(examples), 3, squeeze=False)
        for row, patch in zip(panels, examples, strict=True):
            grid = patch.maplet.grid
            shown = {f"truth, {patch.maplet.name}": patch.truth, "model": patch.maplet.height}
            for panel, (title, height) in zip(row, shown.items(), strict=False):
                grid_image(panel, grid, hillshade(height, grid.gsd), "gray", (0.0, 1.0))
                panel.set_title(title)
            drawn = draw_differences(row[2:], grid, {f"rms {patch.rms:.3f} m": patch.error})
            bar = figure.colorbar(drawn, ax=row[2], shrink=0.9, extend="both", pad=0.02)
            bar.set_label("model − truth, m")
            label_panels(row, grid)
    return figure
