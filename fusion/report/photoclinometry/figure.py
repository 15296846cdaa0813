"""Figure of a maplet solved from images: surface, albedo, sigma, directions, convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.report.layout import Colour, styled_figure
from fusion.report.layout.figures import coded_colours
from fusion.report.maplets import bar_below, grid_image, hillshade, label_panels
from spcola.arrays import FloatArray
from spcola.formats.slope_directions import SlopeDirections
from spcola.grids import Maplet, MapletGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Percentiles of a layer that have the first and the last colour.
_ENDS = (0.5, 99.5)
# Least range of the colours of albedo: a .MAP has it in steps of 0.01.
_LEAST_ALBEDO = 0.06
_LAYERS = ("surface", "albedo", "sigma")


def solved_figure(
    maplet: Maplet,
    rounds: Sequence[Mapping[str, Any]],
    directions: SlopeDirections | None = None,
) -> Figure:
    """Draw a solved maplet.

    Parameters
    ----------
    maplet : Maplet
    rounds : sequence of mapping
        As ``photoclinometry.json`` has them; empty where there was none.
    directions : SlopeDirections, optional
        Which slopes images determine; without it there is no panel of them.
    """
    grid = maplet.grid
    layers = [*_LAYERS, *([] if directions is None else ["directions"])]
    places = [[*layers, "residual"], [*layers, "changes"]]
    with styled_figure(2.75 * len(layers) + 2.95, 3.5) as figure:
        panels: dict[str, Any] = figure.subplot_mosaic(
            places, width_ratios=[*(1.0 for _ in layers), 0.95]
        )
        shade = hillshade(maplet.height, grid.gsd)
        drawn = grid_image(panels["surface"], grid, shade, "gray", (0.0, 1.0))
        bar = bar_below(figure, drawn, panels["surface"], "lit from the upper left", ticks=[])
        bar.solids.set_visible(False)
        bar.outline.set_visible(False)
        panels["surface"].set_title(f"{maplet.name}: surface")
        for name, layer, colours, unit, least in (
            ("albedo", maplet.albedo, "gray", "relative albedo", _LEAST_ALBEDO),
            ("sigma", maplet.sigma, "cividis", "sigma of the height, m", 0.0),
        ):
            drawn = grid_image(panels[name], grid, layer.T, colours, _ends(layer, least))
            bar_below(figure, drawn, panels[name], unit, extend="both")
            panels[name].set_title(name)
        if directions is not None:
            _directions(figure, panels["directions"], grid, directions)
        label_panels([panels[name] for name in layers], grid)
        _convergence(panels["residual"], panels["changes"], rounds, grid.gsd)
    return figure


def _directions(figure: Figure, panel: Any, grid: MapletGrid, directions: SlopeDirections) -> None:
    """Draw in how many directions images determine the slope of each cell, with a legend."""
    half = grid.half_size * grid.gsd
    drawn = panel.imshow(
        directions.count.T,
        extent=(-half, half, -half, half),
        interpolation="nearest",
        **coded_colours("directions"),
    )
    bar_below(
        figure, drawn, panel, "directions in which images determine the slope", ticks=[0, 1, 2]
    )
    panel.set_title("directions")


def _convergence(above: Any, below: Any, rounds: Sequence[Mapping[str, Any]], gsd: float) -> None:
    """Draw residuals, and changes of heights and albedo, by round; a line where the GSD changes."""
    above.set_title("convergence")
    if not rounds:
        for panel in (above, below):
            panel.axis("off")
        above.text(0.0, 0.5, "no round: the start is kept", transform=above.transAxes, fontsize=8)
        return
    numbers = np.arange(1, len(rounds) + 1)
    residual, height, albedo, gsds = (
        np.array([np.nan if one[key] is None else one[key] for one in rounds], dtype=float)
        for key in ("residual", "height_m", "albedo", "gsd_m")
    )
    above.plot(numbers, 100.0 * residual, "o-", ms=3, lw=1.2, color=Colour.TEXT)
    above.set_ylabel("residual, %")
    above.set_ylim(bottom=0.0)
    above.tick_params(labelbottom=False)
    for values, style, colour, label in (
        (height / gsd, "o-", Colour.SPC, "heights, GSD"),
        (albedo, "s--", Colour.LIDAR, "albedo"),
    ):
        # Heights are kept where only the albedo was solved.
        if np.isnan(values).all():
            continue
        below.semilogy(
            numbers, np.maximum(values, 1e-6), style, ms=3, lw=1.2, color=colour, label=label
        )
    below.set_ylabel("changes")
    below.set_xlabel("round")
    below.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.97), ncols=2, handlelength=1.6)
    for panel in (above, below):
        panel.set_xlim(0.5, len(rounds) + 0.5)
        panel.grid(axis="y")
        for place in numbers[1:][np.diff(gsds) != 0.0]:
            panel.axvline(place - 0.5, color=Colour.GREY, lw=0.8, ls=":")


def _ends(layer: FloatArray, least: float) -> tuple[float, float]:
    """Return the values of the first and the last colour, `least` apart or more."""
    known = layer[np.isfinite(layer)]
    if not known.size:
        return 0.0, 1.0
    low, high = (float(part) for part in np.percentile(known, _ENDS))
    more = max(0.5 * (least - (high - low)), 0.0)
    return low - more, max(high + more, low + 1e-6)
