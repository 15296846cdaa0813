"""Figures of one place: hillshades, differences, and sources of the fused heights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.fusing.maplets import FusedMaplet
from fusion.report.data import Surfaces
from fusion.report.style.style import INK, SOURCE_COLOURS, SOURCES, drawing
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSING = "#d5e8c0"
"""Where nothing is known: pale green, which is in none of the colour maps."""


def hillshade(height: FloatArray, gsd: float) -> FloatArray:
    """Shade (rows along Ux, columns along Uy) of `height`, 0 … 1; light from the upper left.

    Parameters
    ----------
    height : (2q+1, 2q+1) ndarray
        Metres, indexed as on a maplet.
    gsd : float
        Metres.

    Returns
    -------
    (2q+1, 2q+1) ndarray
        As an image: first row at the top. NaN where the height is unknown.
    """
    image = height.T
    down, right = _slope(image, gsd), _slope(image.T, gsd).T
    # Sun at 45° elevation, from the upper left of the image.
    light = np.array([-0.5, -0.5, np.sqrt(0.5)])
    cosine = (light[2] - light[0] * right - light[1] * down) / np.sqrt(1 + right**2 + down**2)
    shade: FloatArray = np.where(np.isfinite(image), np.clip(cosine, 0.0, 1.0), np.nan)
    return shade


def _slope(image: FloatArray, gsd: float) -> FloatArray:
    """Return the slope down the rows: mean of the steps to known neighbours, else 0."""
    steps = np.diff(image, axis=0, append=np.nan) / gsd
    before = np.vstack([np.full((1, image.shape[1]), np.nan), steps[:-1]])
    known = np.isfinite(steps).astype(float) + np.isfinite(before)
    slope: FloatArray = (np.nan_to_num(steps) + np.nan_to_num(before)) / np.maximum(known, 1.0)
    return slope


def north_on_image(grid: MapletGrid) -> FloatArray | None:
    """Return the direction of north in the image as (right, up), unit length; None at a pole."""
    pole = np.array([grid.uy[2], -grid.ux[2]])
    length = float(np.linalg.norm(pole))
    return None if length < 1e-3 else pole / length


def surfaces_figure(place: Surfaces) -> Figure:
    """Nine panels: three surfaces, three differences, and sigma, lidar count, source."""
    grid = place.fused.grid
    fused = place.fused.height
    shades = {"SPC": place.spc, "lidar, registered": place.lidar, "fused": fused}
    gaps = {
        "fused − SPC": fused - place.spc,
        "fused − lidar": fused - place.lidar,
        "lidar − SPC": place.lidar - place.spc,
    }
    with drawing(9.4, 9.6) as figure:
        panels = figure.subplots(3, 3)
        for panel, (title, height) in zip(panels[0], shades.items(), strict=True):
            grid_image(panel, grid, hillshade(height, grid.gsd), "gray", (0.0, 1.0))
            panel.set_title(title)
        north_and_scale(panels[0, 0], grid)
        limit = symmetric_limit(list(gaps.values()))
        for panel, (title, gap) in zip(panels[1], gaps.items(), strict=True):
            drawn = grid_image(panel, grid, gap.T, "RdBu_r", (-limit, limit))
            panel.set_title(title)
            write_statistics(panel, gap)
        bar = figure.colorbar(drawn, ax=panels[1].tolist(), shrink=0.85, extend="both", pad=0.01)
        bar.set_label("height difference, m")
        _origins(figure, panels[2], place)
        for panel in panels.flat:
            label_axes(panel)
    return figure


def grid_image(
    panel: Any, grid: MapletGrid, image: FloatArray, colours: str, limits: tuple[float, float]
) -> Any:
    """Draw an image in metres about the maplet's centre: right along Uy, up along −Ux."""
    import matplotlib as mpl  # noqa: PLC0415

    half = (grid.half_size + 0.5) * grid.gsd
    palette = mpl.colormaps[colours].with_extremes(bad=MISSING)
    return panel.imshow(
        np.ma.masked_invalid(image),
        cmap=palette,
        vmin=limits[0],
        vmax=limits[1],
        extent=(-half, half, -half, half),
        interpolation="nearest",
    )


def _origins(figure: Figure, panels: Any, place: Surfaces) -> None:
    """Draw sigma, count and source of the fused heights."""
    fused, grid = place.fused, place.fused.grid
    known = fused.sigma[np.isfinite(fused.sigma)]
    top = float(np.percentile(known, 99)) if known.size else 1.0
    sigma = grid_image(panels[0], grid, fused.sigma.T, "cividis", (0.0, max(top, 1e-6)))
    bar_below(figure, sigma, panels[0], "m", extend="max")
    panels[0].set_title("sigma of the fused height")
    most = max(1.0, float(np.percentile(fused.count, 99)))
    count = grid_image(panels[1], grid, fused.count.T.astype(float), "viridis", (0.0, most))
    bar_below(figure, count, panels[1], "returns in a cell", extend="max")
    panels[1].set_title("lidar returns")
    draw_sources(figure, panels[2], fused)
    panels[2].set_title("heights rest on")


def draw_sources(figure: Figure, panel: Any, fused: FusedMaplet) -> None:
    """Draw what the heights of a fused maplet rest on."""
    from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: PLC0415

    half = (fused.grid.half_size + 0.5) * fused.grid.gsd
    source = panel.imshow(
        fused.source.T,
        cmap=ListedColormap(SOURCE_COLOURS),
        norm=BoundaryNorm(np.arange(-0.5, 5.0), 5),
        extent=(-half, half, -half, half),
        interpolation="nearest",
    )
    bar = bar_below(figure, source, panel, "", ticks=range(5))
    bar.ax.set_xticklabels(SOURCES)


def bar_below(figure: Figure, drawn: Any, panel: Any, label: str, **options: Any) -> Any:
    """Draw a colour bar under a panel."""
    bar = figure.colorbar(drawn, ax=panel, location="bottom", shrink=0.9, aspect=24, **options)
    bar.set_label(label)
    return bar


def symmetric_limit(gaps: list[FloatArray]) -> float:
    """Return the 98th percentile of all absolute differences, a limit robust to outliers."""
    sizes = np.concatenate([np.abs(gap[np.isfinite(gap)]) for gap in gaps])
    return max(float(np.percentile(sizes, 98)), 1e-6) if sizes.size else 1.0


def write_statistics(panel: Any, gap: FloatArray) -> None:
    """Write mean and standard deviation into a difference panel."""
    known = gap[np.isfinite(gap)]
    text = "no common point"
    if known.size:
        text = f"mean {known.mean():+.3f} m\nstd {known.std():.3f} m".replace("-", "−")
    box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 2.0}
    panel.text(0.03, 0.03, text, transform=panel.transAxes, fontsize=7.5, bbox=box, va="bottom")


def label_axes(panel: Any) -> None:
    """Label the axes of an image panel on the left and lower edges of the figure only."""
    place = panel.get_subplotspec()
    for spine in panel.spines.values():
        spine.set_visible(True)
    if place.is_last_row():
        panel.set_xlabel("along Uy, m")
    if place.is_first_col():
        panel.set_ylabel("along −Ux, m")
    panel.tick_params(labelbottom=place.is_last_row(), labelleft=place.is_first_col())


def north_and_scale(panel: Any, grid: MapletGrid) -> None:
    """Draw a north arrow and a scale bar."""
    half = (grid.half_size + 0.5) * grid.gsd
    box = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "boxstyle": "round,pad=0.2"}
    north = north_on_image(grid)
    if north is not None:
        foot = np.array([0.74, 0.74]) * half
        tip = foot + 0.2 * half * north
        arrow = {"arrowstyle": "-|>", "color": "white", "lw": 2.4}
        panel.annotate(
            "", tip, foot - 0.1 * half * north, arrowprops={**arrow, "lw": 4.0, "color": INK}
        )
        panel.annotate("", tip, foot - 0.1 * half * north, arrowprops=arrow)
        at = foot - 0.24 * half * north
        panel.text(*at, "N", ha="center", va="center", fontsize=8, weight="bold", bbox=box)
    length = round_length(0.7 * half)
    left, low = -0.9 * half, -0.88 * half
    panel.plot([left, left + length], [low, low], color=INK, lw=5, solid_capstyle="butt")
    panel.plot([left, left + length], [low, low], color="white", lw=2.5, solid_capstyle="butt")
    panel.text(left, low + 0.07 * half, f"{length:g} m", fontsize=8, va="bottom", bbox=box)


def round_length(metres: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten below `metres`."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(max(step * power for step in (1, 2, 5) if step * power <= metres))
