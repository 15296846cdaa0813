"""The layers of surfaces: meaning, unit, how they are reduced and coloured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fusion.inspection.look import limits_of
from fusion.report.maplets import symmetric_limit
from fusion.service.views.surfaces.levels import Rule
from spcola.arrays import FloatArray


@dataclass(frozen=True)
class LayerKind:
    """What a layer means.

    Attributes
    ----------
    text, unit : str
    rule : Rule
        How a level is made of grid points.
    colours : str
        Name of a Matplotlib colour map; "source" and "directions" for the colours of codes.
    range : {"percentiles", "symmetric", "from zero", "fixed"}
        How the range of colours follows from the values: their 0.5th and 99.5th percentile; the
        98th of their sizes on both sides of 0; 0 and the 99.5th percentile; the same for all.
    fixed : (float, float)
        The range, if fixed.
    """

    text: str
    unit: str
    rule: Rule
    colours: str
    range: str = "percentiles"
    fixed: tuple[float, float] = (0.0, 1.0)


LAYERS: Mapping[str, LayerKind] = {
    "height": LayerKind("height along Uz above the plane of the grid", "m", Rule.MEAN, "viridis"),
    "sigma": LayerKind(
        "one standard deviation of the height", "m", Rule.SIGMA, "cividis", "from zero"
    ),
    "hillshade": LayerKind(
        "relief lit from the upper left, 45° high", "", Rule.MEAN, "gray", "fixed"
    ),
    "albedo": LayerKind("relative albedo", "", Rule.MEAN, "gray"),
    "count": LayerKind("lidar returns in the cell", "", Rule.SUM, "viridis", "from zero"),
    "source": LayerKind(
        "what the height rests on: 0 none, 1 image, 2 lidar, 3 both, 4 filled",
        "", Rule.NEAREST, "source", "fixed", (0.0, 4.0),
    ),
    "difference": LayerKind(
        "height less that of the SPC surface there", "m", Rule.MEAN, "RdBu_r", "symmetric"
    ),
    "slope": LayerKind(
        "angle between the ground, from neighbouring grid points, and the plane of the grid",
        "°", Rule.MEAN, "cividis", "fixed", (0.0, 60.0),
    ),
    "directions": LayerKind(
        "in how many directions images determine the slope: fewest of the cells around a point",
        "", Rule.NEAREST, "directions", "fixed", (0.0, 2.0),
    ),
}  # fmt: skip
"""All layers by name. The colour maps remain distinct for colour-blind readers."""


def range_of(layer: str, values: FloatArray) -> tuple[float, float] | None:
    """Return the range of colours for the `values` of a layer; None if none is known."""
    kind = LAYERS[layer]
    if not np.isfinite(values).any():
        return None
    if kind.range == "symmetric":
        limit = symmetric_limit(values)
        return -limit, limit
    low, high = limits_of(values)
    return (low, high) if kind.range == "percentiles" else (0.0, max(high, 1e-12))
