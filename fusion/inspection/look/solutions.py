"""Picture of the difference of two solutions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.inspection.look.picture import Picture, set_title
from fusion.inspection.solution_difference import SolutionDifference, difference_lines
from fusion.report.figures import graticule
from fusion.report.layout import Colour, styled_figure
from spcola.math import lon_lat_deg

if TYPE_CHECKING:
    from spcola.arrays import FloatArray

# Share of the displacements within the range of colours.
_SHOWN = 98


def difference_picture(found: SolutionDifference) -> Picture:
    """Draw how far centres of maplets and states of images moved in the difference `found`.

    A map of the centres, coloured by their displacement along the normal, and the distributions of
    displacements, changes of heights, and of positions and pointing of images.
    """
    with styled_figure(11.0, 6.4) as figure:
        panels: Any = figure.subplot_mosaic(
            [["map", "map", "centers"], ["heights", "positions", "turns"]],
            height_ratios=[1.5, 1.0],
        )
        _map(figure, panels["map"], found)
        left = np.linalg.norm(found.left_over, axis=1)
        _histogram(panels["centers"], "centres, m", np.linalg.norm(found.moved, axis=1), left)
        _histogram(panels["heights"], "heights within a maplet, m", found.heights)
        _histogram(panels["positions"], "spacecraft, m", np.linalg.norm(found.positions, axis=1))
        turned = np.degrees(np.linalg.norm(found.turns, axis=1))
        _histogram(panels["turns"], "pointing, °", turned)
        lines = difference_lines(found.as_json())
        together = [line.strip() for line in lines if "together" in line or "→" in line]
        title = f"Solution {found.second} less {found.first}"
        set_title(figure, title, "\n".join(together))
    return Picture("difference of solutions", figure, found.as_json())


def _map(figure: Any, panel: Any, found: SolutionDifference) -> None:
    """Draw the centres, coloured by their displacement along the normal."""
    graticule(panel)
    panel.set_title("centres of maplets, displaced outward, m")
    if not len(found.centers):
        return
    longitude, latitude = lon_lat_deg(found.centers)
    most = max(float(np.percentile(np.abs(found.outward), _SHOWN)), 1e-12)
    drawn = panel.scatter(longitude, latitude, c=found.outward, s=16, cmap="RdBu_r",
                          vmin=-most, vmax=most, edgecolors=Colour.TEXT,
                          linewidths=0.3)  # fmt: skip
    figure.colorbar(drawn, ax=panel, shrink=0.8)


def _histogram(panel: Any, title: str, values: FloatArray, left: FloatArray | None = None) -> None:
    """Draw the distribution of displacements; those beyond a common similarity over it."""
    panel.set_title(title)
    known = values[np.isfinite(values)]
    if not known.size:
        panel.text(0.5, 0.5, "none to compare", transform=panel.transAxes, ha="center")
        return
    panel.set_ylabel("number")
    panel.yaxis.get_major_locator().set_params(integer=True)
    edges = np.linspace(0.0, max(float(known.max()), 1e-12), 25)
    panel.hist(known, edges, color=Colour.SPC, label="all")
    if left is not None:
        panel.hist(left, edges, histtype="step", color=Colour.LIDAR, lw=1.5,
                   label="beyond a common similarity")  # fmt: skip
        panel.legend(fontsize=7)
