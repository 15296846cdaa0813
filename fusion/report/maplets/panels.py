"""Panels of figures that show maplets: images of layers, differences, sources, axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.fusing.maplets import FusedMaplet
from fusion.report.layout import Colour
from fusion.report.layout.figures import SOURCES, coded_colours
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def north_on_image(grid: MapletGrid) -> FloatArray | None:
    """Return the direction of north in the image as (right, up), unit length; None at a pole."""
    pole = np.array([grid.uy[2], -grid.ux[2]])
    length = float(np.linalg.norm(pole))
    return None if length < 1e-3 else pole / length


def grid_image(
    panel: Any, grid: MapletGrid, image: FloatArray, colours: str, limits: tuple[float, float]
) -> Any:
    """Draw an image in metres about the maplet's centre: right along Uy, up along −Ux."""
    import matplotlib as mpl  # noqa: PLC0415

    half = (grid.half_size + 0.5) * grid.gsd
    palette = mpl.colormaps[colours].with_extremes(bad=Colour.MISSING)
    return panel.imshow(
        np.ma.masked_invalid(image),
        cmap=palette,
        vmin=limits[0],
        vmax=limits[1],
        extent=(-half, half, -half, half),
        interpolation="nearest",
    )


def draw_sources(figure: Figure, panel: Any, fused: FusedMaplet) -> None:
    """Draw what the heights of a fused maplet rest on."""
    half = (fused.grid.half_size + 0.5) * fused.grid.gsd
    source = panel.imshow(
        fused.source.T,
        extent=(-half, half, -half, half),
        interpolation="nearest",
        **coded_colours("source"),
    )
    bar = bar_below(figure, source, panel, "", ticks=range(len(SOURCES)))
    bar.ax.set_xticklabels(SOURCES)


def bar_below(figure: Figure, drawn: Any, panel: Any, label: str, **options: Any) -> Any:
    """Draw a colour bar under a panel."""
    bar = figure.colorbar(drawn, ax=panel, location="bottom", shrink=0.9, aspect=24, **options)
    bar.set_label(label)
    return bar


def symmetric_limit(*gaps: FloatArray) -> float:
    """Return the 98th percentile of all absolute differences, a limit robust to outliers."""
    sizes = np.concatenate([np.abs(gap[np.isfinite(gap)]) for gap in gaps])
    return max(float(np.percentile(sizes, 98)), 1e-6) if sizes.size else 1.0


def draw_differences(
    panels: Iterable[Any], grid: MapletGrid, gaps: Mapping[str, FloatArray]
) -> Any:
    """Draw differences of heights, one in each panel, on one scale, with mean and deviation.

    Parameters
    ----------
    panels : iterable of Axes
    grid : MapletGrid
    gaps : mapping of str to (2q+1, 2q+1) ndarray
        Differences by their titles, metres; NaN where unknown.

    Returns
    -------
    AxesImage
        The last one, for a colour bar.
    """
    limit = symmetric_limit(*gaps.values())
    for panel, (title, gap) in zip(panels, gaps.items(), strict=True):
        drawn = grid_image(panel, grid, gap.T, "RdBu_r", (-limit, limit))
        panel.set_title(title)
        known = gap[np.isfinite(gap)]
        text = "no common point"
        if known.size:
            text = f"mean {known.mean():+.3f} m\nstd {known.std():.3f} m".replace("-", "−")
        box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 2.0}
        panel.text(0.03, 0.03, text, transform=panel.transAxes, fontsize=7.5, bbox=box, va="bottom")
    return drawn


def label_panels(panels: Iterable[Any], grid: MapletGrid) -> None:
    """Label the axes of panels with images of one grid; a north arrow and a scale on the first."""
    for number, panel in enumerate(panels):
        _label_axes(panel)
        if number == 0:
            _north_and_scale(panel, grid)


def _label_axes(panel: Any) -> None:
    """Label the axes of an image panel on the left and lower edges of the figure only."""
    place = panel.get_subplotspec()
    for spine in panel.spines.values():
        spine.set_visible(True)
    if place.is_last_row():
        panel.set_xlabel("along Uy, m")
    if place.is_first_col():
        panel.set_ylabel("along −Ux, m")
    panel.tick_params(labelbottom=place.is_last_row(), labelleft=place.is_first_col())


def _north_and_scale(panel: Any, grid: MapletGrid) -> None:
    """Draw a north arrow and a scale bar."""
    half = (grid.half_size + 0.5) * grid.gsd
    box = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "boxstyle": "round,pad=0.2"}
    north = north_on_image(grid)
    if north is not None:
        foot = np.array([0.74, 0.74]) * half
        tip = foot + 0.2 * half * north
        arrow = {"arrowstyle": "-|>", "color": "white", "lw": 2.4}
        panel.annotate(
            "",
            tip,
            foot - 0.1 * half * north,
            arrowprops={**arrow, "lw": 4.0, "color": Colour.TEXT},
        )
        panel.annotate("", tip, foot - 0.1 * half * north, arrowprops=arrow)
        at = foot - 0.24 * half * north
        panel.text(*at, "N", ha="center", va="center", fontsize=8, weight="bold", bbox=box)
    length = round_length(0.7 * half)
    left, low = -0.9 * half, -0.88 * half
    panel.plot([left, left + length], [low, low], color=Colour.TEXT, lw=5, solid_capstyle="butt")
    panel.plot([left, left + length], [low, low], color="white", lw=2.5, solid_capstyle="butt")
    panel.text(left, low + 0.07 * half, f"{length:g} m", fontsize=8, va="bottom", bbox=box)


def round_length(metres: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten below `metres`."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(max(step * power for step in (1, 2, 5) if step * power <= metres))
