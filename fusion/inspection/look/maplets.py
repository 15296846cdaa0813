"""Pictures of surfaces on a grid: maplets, bigmaps, mapolas, fused maplets and pairs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.fusing.maplets import FUSED_HDF5, FusedMaplet, Source, fused_names, read_fused
from fusion.inspection.look.numbers import place_text
from fusion.inspection.look.picture import Picture, set_title
from fusion.inspection.look.shading import colour_bar, limits_of, note_gaps, shaded_colours
from fusion.report.layout import styled_figure
from fusion.report.maplets import (
    bar_below,
    draw_differences,
    draw_sources,
    grid_image,
    hillshade,
    label_panels,
)
from lidar.formats.mapolas import MAPOLAS_HDF5, mapola_names, read_mapola
from lidar.gridding import Mapola
from spcola.arrays import AnyArray, FloatArray
from spcola.formats.maplets import read_maplet
from spcola.grids import Maplet, project_maplet
from spcola.math import lon_lat_deg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PAIR = ("maplets", "returns")
# Folders of bigmaps: of fused maplets, of maplets, of returns, with solved albedo.
_BIGMAPS = ("bigmaps", "maplets", "returns", "albedo")
_SIDE_IN = 4.4


def read_surface_file(path: Path) -> Maplet:
    """Read a .MAP with all that its workspace knows of it.

    In a folder of mapolas or fused maplets the layers that a .MAP cannot hold are read from the
    HDF5 of the same folder.

    Raises
    ------
    SpcolaError
        If a file cannot be read, or the two do not belong together.
    """
    folder, name = path.parent, path.stem
    if (folder / FUSED_HDF5).is_file() and name in fused_names(folder):
        return read_fused(folder, name)
    if (folder / MAPOLAS_HDF5).is_file() and name in mapola_names(folder):
        return read_mapola(folder, name)
    return read_maplet(path)


def look_at_map(path: Path) -> Picture:
    """Draw a .MAP: a pair of bigmaps if its partner is in the same folder, else the surface."""
    partner = _partner(path)
    if partner is not None:
        return pair_picture(read_maplet(partner[0]), read_maplet(partner[1]))
    maplet = read_surface_file(path)
    return maplet_picture(maplet, "bigmap" if path.absolute().parent.name in _BIGMAPS else "")


def maplet_picture(maplet: Maplet, kind: str = "") -> Picture:
    """Draw shaded relief, heights, and the layers that are known: sigma, albedo, counts, sources.

    Parameters
    ----------
    maplet : Maplet
        A mapola and a fused maplet too, each with the layers of its own.
    kind : str
        What it is called; by its type if empty.
    """
    layers = _layers(maplet)
    columns = 2 if len(layers) in (2, 4) else 3
    rows = -(-len(layers) // columns)
    kind, facts = kind or _kind(maplet), maplet_extents(maplet)
    if isinstance(maplet, FusedMaplet):
        facts["share_by_source"] = {each.name.lower(): maplet.share(each) for each in Source}
    with styled_figure(_SIDE_IN * columns, (_SIDE_IN + 0.35) * rows + 0.5) as figure:
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel, (title, draw) in zip(panels, layers, strict=False):
            panel.set_title(title)
            draw(figure, panel)
        label_panels(panels[: len(layers)], maplet.grid)
        for panel in panels[len(layers) :]:
            panel.axis("off")
        note_gaps(panels[0], ~maplet.valid)
        set_title(figure, f"{maplet.name}, {kind}", _caption(maplet))
    return Picture(kind, figure, facts)


def pair_picture(maplets: Maplet, returns: Maplet) -> Picture:
    """Draw the two bigmaps of a pair, of maplets and of returns, and their difference."""
    other = project_maplet(returns, maplets.grid).height
    gap = other - maplets.height
    with styled_figure(3 * _SIDE_IN, _SIDE_IN + 0.85) as figure:
        panels = figure.subplots(1, 3)
        for panel, title, height in (
            (panels[0], "images: bigmap of maplets", maplets.height),
            (panels[1], "lidar: bigmap of returns", other),
        ):
            panel.set_title(title)
            _draw_heights(figure, panel, maplets, height)
            note_gaps(panel, ~np.isfinite(height))
        drawn = draw_differences(panels[2:], maplets.grid, {"difference, as they lie": gap})
        bar_below(figure, drawn, panels[2], "lidar − images along Uz, m", extend="both")
        label_panels(panels, maplets.grid)
        image = maplets.name.removesuffix("-maplets")
        set_title(figure, f"{image}, pair of bigmaps", _caption(maplets))
    known = gap[np.isfinite(gap)]
    facts = {
        **maplet_extents(maplets),
        "common_points": int(known.size),
        "difference_mean_m": float(known.mean()) if known.size else None,
        "difference_std_m": float(known.std()) if known.size else None,
    }
    return Picture("pair of bigmaps", figure, facts)


def maplet_extents(maplet: Maplet) -> dict[str, Any]:
    """Return where a maplet lies and what it spans, for ``--json``."""
    grid = maplet.grid
    longitude, latitude = lon_lat_deg(grid.center)
    known = maplet.height[maplet.valid]
    return {
        "name": maplet.name,
        "center_m": grid.center,
        "longitude_deg": float(longitude),
        "latitude_deg": float(latitude),
        "gsd_m": grid.gsd,
        "side_m": (grid.size - 1) * grid.gsd,
        "height_m": [float(known.min()), float(known.max())] if known.size else None,
        "missing": int(np.count_nonzero(~maplet.valid)),
    }


def _partner(path: Path) -> tuple[Path, Path] | None:
    """Return both bigmaps of a pair, of maplets first; None where `path` is of none."""
    image, dash, kind = path.stem.rpartition("-")
    if not dash or kind not in _PAIR:
        return None
    both = tuple(path.with_name(f"{image}-{each}{path.suffix}") for each in _PAIR)
    return (both[0], both[1]) if all(each.is_file() for each in both) else None


def _kind(maplet: Maplet) -> str:
    if isinstance(maplet, FusedMaplet):
        return "fused maplet"
    return "mapola" if isinstance(maplet, Mapola) else "maplet"


def _caption(maplet: Maplet) -> str:
    """Say where a maplet lies, how large it is, and how its axes run."""
    grid = maplet.grid
    return (
        f"Centre {place_text(grid.center)}, "
        f"{np.linalg.norm(grid.center):.6g} m from the body's centre; {grid.size} × {grid.size} "
        f"points at {grid.gsd:.4g} m. Heights along Uz; right is along Uy, up along −Ux."
    )


_Layer = tuple[str, Callable[[Any, Any], None]]


def _layers(maplet: Maplet) -> list[_Layer]:
    """Return title and drawing of each panel."""
    grid, height = maplet.grid, maplet.height

    def relief(figure: Figure, panel: Any) -> None:
        drawn = grid_image(panel, grid, hillshade(height, grid.gsd), "gray", (0.0, 1.0))
        # An empty bar keeps the panel as large as the others.
        bar = bar_below(figure, drawn, panel, "lit from the upper left, 45° high", ticks=[])
        bar.solids.set_visible(False)
        bar.outline.set_visible(False)

    def heights(figure: Figure, panel: Any) -> None:
        _draw_heights(figure, panel, maplet, height)

    found: list[_Layer] = [("shaded relief", relief), ("height", heights)]
    if np.isfinite(maplet.sigma).any():
        found.append(("sigma of the height", _of(maplet, maplet.sigma, "cividis", "sigma, m")))
    if isinstance(maplet, Mapola):
        found.append(_counts(maplet, maplet.count))
        if np.isfinite(maplet.spread).any():
            found.append(("spread in a cell", _of(maplet, maplet.spread, "cividis", "spread, m")))
    elif isinstance(maplet, FusedMaplet):
        found.append(_counts(maplet, maplet.count))
        found.append(("heights rest on", lambda f, p: draw_sources(f, p, maplet)))
    elif np.ptp(maplet.albedo[maplet.valid]) > 0 if maplet.valid.any() else False:
        albedo = np.where(maplet.valid, maplet.albedo, np.nan)
        found.append(("albedo", _of(maplet, albedo, "gray", "relative albedo", from_zero=False)))
    return found


def _counts(maplet: Maplet, count: AnyArray) -> _Layer:
    shown = np.where(count > 0, count, np.nan).astype(np.float64)
    return "lidar returns", _of(maplet, shown, "viridis", "returns in a cell")


def _of(
    maplet: Maplet, layer: FloatArray, colours: str, label: str, *, from_zero: bool = True
) -> Callable[[Any, Any], None]:
    """Return what draws a layer with a colour bar."""
    low, high = limits_of(layer)
    limits = (0.0 if from_zero else low, high)

    def draw(figure: Figure, panel: Any) -> None:
        drawn = grid_image(panel, maplet.grid, layer.T, colours, limits)
        bar_below(figure, drawn, panel, label, extend="max" if from_zero else "both")

    return draw


def _draw_heights(figure: Figure, panel: Any, maplet: Maplet, height: FloatArray) -> None:
    """Draw heights as colours over their shaded relief."""
    grid, limits = maplet.grid, limits_of(height)
    image = shaded_colours(height.T, hillshade(height, grid.gsd), "viridis", limits)
    half = (grid.half_size + 0.5) * grid.gsd
    panel.imshow(image, extent=(-half, half, -half, half), interpolation="nearest")
    colour_bar(figure, panel, ("viridis", limits), "height along Uz, m")
