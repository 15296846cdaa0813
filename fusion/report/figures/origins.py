"""The map of the body that shows what its surface rests on: images, lidar, or both."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.report.data import Origins
from fusion.report.layout import Colour, styled_figure
from fusion.report.layout.figures import SOURCE_COLOURS, SOURCES, coded_colours
from spcola.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SourceAt = Callable[[FloatArray], FloatArray]
"""Returns the sources (…) at directions (…, 3); NaN where no maplet lies."""

_ROWS = 180
# Odd, so that few pixels are undecided.
_NEIGHBOURS = 9
# A polar view ends at this latitude, degrees.
_POLAR_EDGE = 30.0
# A pixel further than this from any point, in mean distances of points, lies on no maplet.
_MOST_APART = 3.0


def origins_figure(origins: Origins) -> Figure:
    """Draw what the fused heights rest on: by longitude and latitude, and seen from both poles."""
    source_at = _most_frequent(origins)
    with styled_figure(9.4, 4.2) as figure:
        panels: Any = figure.subplot_mosaic(
            [["map", "north"], ["map", "south"]], width_ratios=[2.1, 1.0]
        )
        _draw(panels["map"], source_at(_by_place()), (0.0, 360.0, -90.0, 90.0))
        panels["map"].set(xticks=range(0, 361, 60), yticks=range(-90, 91, 30))
        panels["map"].set(xlabel="east longitude, °", ylabel="latitude, °")
        edge = float(np.cos(np.radians(_POLAR_EDGE)))
        for name, side in (("north", 1.0), ("south", -1.0)):
            image = source_at(_from_pole(side, edge))
            _draw(panels[name], image, (-edge, edge, -edge, edge))
            _polar_graticule(panels[name], side, edge)
            panels[name].set_title(f"{name} pole", loc="center", fontsize=9)
        _legend(figure, origins)
    return figure


def _most_frequent(origins: Origins) -> SourceAt:
    """Return what gives the source that most of the nearest points have."""
    from scipy.spatial import cKDTree  # noqa: PLC0415

    lengths = np.linalg.norm(origins.directions, axis=1, keepdims=True)
    tree = cKDTree(origins.directions / lengths)
    reach = _MOST_APART * np.sqrt(4.0 * np.pi / len(lengths))
    # A point that is not there comes last.
    sources = np.append(origins.source, len(SOURCES)).astype(int)

    def source_at(directions: FloatArray) -> FloatArray:
        inside = np.isfinite(directions).all(axis=-1)
        nearest = tree.query(directions[inside], k=_NEIGHBOURS, distance_upper_bound=reach)[1]
        found = sources[nearest]
        counts = np.stack([np.sum(found == k, axis=1) for k in range(len(SOURCES))], axis=1)
        image = np.full(inside.shape, np.nan)
        image[inside] = np.where(counts.any(axis=1), counts.argmax(axis=1), np.nan)
        return image

    return source_at


def _by_place() -> FloatArray:
    """Return directions (R, 2 R, 3) of the pixels of a map, south first."""
    latitude = np.radians((np.arange(_ROWS) + 0.5) * 180.0 / _ROWS - 90.0)[:, None]
    longitude = np.radians((np.arange(2 * _ROWS) + 0.5) * 180.0 / _ROWS)
    return np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ),
        axis=-1,
    )


def _from_pole(side: float, edge: float) -> FloatArray:
    """Return directions (R, R, 3) of the pixels of a view from above a pole; side −1: the south.

    Y of the body is up, and its X to the right in the north, to the left in the south; NaN beyond
    the edge.
    """
    steps = edge * ((2.0 * np.arange(_ROWS) + 1.0) / _ROWS - 1.0)
    right, up = np.meshgrid(steps, steps)
    level = right**2 + up**2
    directions = np.stack([side * right, up, side * np.sqrt(np.maximum(0.0, 1.0 - level))], axis=-1)
    directions[level > edge**2] = np.nan
    return directions


def _draw(panel: Any, image: FloatArray, extent: tuple[float, float, float, float]) -> None:
    """Draw sources as colours; the first row is the lowest."""
    panel.imshow(
        np.ma.masked_invalid(image),
        extent=extent,
        origin="lower",
        interpolation="nearest",
        **coded_colours("source"),
    )


def _polar_graticule(panel: Any, side: float, edge: float) -> None:
    """Draw circles of latitude and four meridians."""
    around = np.linspace(0.0, 2.0 * np.pi, 181)
    for latitude in (_POLAR_EDGE, 60.0):
        radius = np.cos(np.radians(latitude))
        panel.plot(radius * np.cos(around), radius * np.sin(around), color=Colour.TEXT, lw=0.6)
    for longitude in (0, 90, 180, 270):
        x, y = side * np.cos(np.radians(longitude)), np.sin(np.radians(longitude))
        panel.plot([0.0, edge * x], [0.0, edge * y], color=Colour.TEXT, lw=0.6)
        at = (1.16 * edge * x, 1.12 * edge * y)
        panel.text(*at, f"{longitude}°", ha="center", va="center", fontsize=7.5)
    panel.set(xlim=(-1.3 * edge, 1.3 * edge), ylim=(-1.2 * edge, 1.2 * edge))
    panel.axis("off")


def _legend(figure: Any, origins: Origins) -> None:
    """Name the colours, and how much of all points each source holds."""
    from matplotlib.patches import Patch  # noqa: PLC0415

    shares = [float(np.mean(origins.source == number)) for number in range(len(SOURCES))]
    patches = [
        Patch(facecolor=colour, edgecolor=Colour.GREY, label=f"{name} ({100 * share:.0f} %)")
        for name, colour, share in zip(SOURCES, SOURCE_COLOURS, shares, strict=True)
        if share > 0
    ]
    figure.legend(handles=patches, loc="outside upper center", ncols=len(patches))
