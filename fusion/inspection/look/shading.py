"""Colours over shaded relief, and lengths in the unit that suits them."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.report.layout import Colour
from fusion.report.maplets import bar_below
from spcola.arrays import FloatArray

# How much of a colour the darkest shade leaves.
_DARKEST = 0.45
# How much of the way to white the brightest shade takes it.
_BRIGHTEST = 0.25
# Shade of level ground lit from 45°: it keeps its colour.
_LEVEL = float(np.sqrt(0.5))


def shaded_colours(
    values: FloatArray, shade: FloatArray, colours: str, limits: tuple[float, float]
) -> FloatArray:
    """Return an image (R, C, 4) of values by colour, darker and lighter as the ground is shaded.

    Parameters
    ----------
    values : (R, C) ndarray
        Coloured from the first of `limits` to the second.
    shade : (R, C) ndarray
        0 … 1 (:func:`fusion.report.maplets.hillshade`); NaN where there is no ground.
    colours : str
        Name of a matplotlib colour map.
    limits : (float, float)
        In the unit of `values`.

    Returns
    -------
    (R, C, 4) ndarray
        Red, green, blue and opacity, 0 … 1. Pale green where a value or the shade is unknown.
    """
    import matplotlib as mpl  # noqa: PLC0415
    from matplotlib.colors import to_rgba  # noqa: PLC0415

    known = np.isfinite(values) & np.isfinite(shade)
    span = max(limits[1] - limits[0], np.finfo(float).tiny)
    share = np.clip((np.where(known, values, limits[0]) - limits[0]) / span, 0.0, 1.0)
    image: FloatArray = np.array(mpl.colormaps[colours](share), dtype=np.float64)
    light = np.where(known, shade, _LEVEL)[..., None]
    dark = _DARKEST + (1.0 - _DARKEST) * np.minimum(light / _LEVEL, 1.0)
    bright = np.clip((light - _LEVEL) / (1.0 - _LEVEL), 0.0, 1.0) * _BRIGHTEST
    image[..., :3] = image[..., :3] * dark
    image[..., :3] += (1.0 - image[..., :3]) * bright
    image[~known] = to_rgba(Colour.MISSING)
    return image


def length_unit(largest_m: float) -> tuple[float, str]:
    """Return metres in the unit for lengths up to `largest_m`, and its name: m or km."""
    return (1e3, "km") if largest_m >= 2e4 else (1.0, "m")


def limits_of(values: FloatArray, share: float = 0.5) -> tuple[float, float]:
    """Return the span of the known values, `share` per cent at either end left out.

    Isolated points must not take all the colours. (0, 1) where nothing is known.
    """
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = (float(part) for part in np.percentile(known, (share, 100.0 - share)))
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def colour_bar(figure: Any, panel: Any, scale: tuple[str, tuple[float, float]], label: str) -> None:
    """Draw the colour bar of an image of colours below a panel.

    Parameters
    ----------
    figure, panel : matplotlib Figure and Axes
    scale : (str, (float, float))
        Name of the colour map and its limits.
    label : str
        What is coloured, with its unit.
    """
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import Normalize  # noqa: PLC0415

    colours, limits = scale
    drawn = ScalarMappable(Normalize(*limits), colours)
    bar_below(figure, drawn, panel, label)


def note_gaps(panel: Any, unknown: Any) -> None:
    """Name the colour of what is unknown in a corner of a panel, where anything is."""
    if not np.any(unknown):
        return
    from matplotlib.patches import Patch  # noqa: PLC0415

    share = 100.0 * float(np.mean(unknown))
    text = f"no height: {share:.0f} %" if share >= 1.0 else "no height: < 1 %"
    patch = Patch(facecolor=Colour.MISSING, edgecolor="#888888", linewidth=0.5, label=text)
    panel.legend(handles=[patch], loc="lower right", frameon=True, framealpha=0.85, borderpad=0.3)
