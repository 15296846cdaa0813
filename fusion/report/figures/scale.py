"""Figures of the scale: ε by day, local time and longitude."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.report.layout import Colour, styled_figure
from spcola.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PPM = 1e6


def scale_figure(scale: Mapping[str, Any]) -> Figure:
    """Three panels over one axis of ε: per day, per local time, per longitude.

    Single values are those of pairs or, without pairs, of single shots.
    """
    single = scale.get("per_pair") or scale.get("per_shot") or []
    pairs = [entry for entry in single if entry.get("epsilon") is not None]
    with styled_figure(9.4, 6.6) as figure:
        panels: dict[str, Any] = figure.subplot_mosaic([["day", "day"], ["hour", "longitude"]])
        _by_day(panels["day"], scale)
        _by_angle(panels["hour"], scale, pairs, "local_time_h", (0, 24), "local solar time, h")
        _by_angle(panels["longitude"], scale, pairs, "longitude_deg", (0, 360), "east longitude, °")
        panels["longitude"].sharey(panels["hour"])
    return figure


def _by_day(panel: Any, scale: Mapping[str, Any]) -> None:
    """Daily means with their standard errors."""
    days = scale.get("per_day") or []
    panel.set_title("ε per day: mean and standard error")
    _joint(panel, scale, label="joint fit, ± 1 sigma")
    if not days:
        panel.text(0.5, 0.5, "no daily values", transform=panel.transAxes, ha="center")
        return
    place = np.arange(len(days))
    epsilon = _numbers(days, "epsilon") * _PPM
    error = np.nan_to_num(_numbers(days, "epsilon_sigma")) * _PPM
    panel.errorbar(place, epsilon, error, fmt="o", color=Colour.FUSED, ms=5, capsize=3, zorder=3)
    every = max(1, -(-len(days) // 12))
    labels = [f"{day['day']}\nn = {day.get('n', '?')}" for day in days]
    panel.set_xticks(place[::every], labels[::every])
    panel.set_xlim(-0.7, len(days) - 0.3)
    if scale.get("epsilon") is not None:
        panel.legend(loc="best")


def _by_angle(
    panel: Any,
    scale: Mapping[str, Any],
    pairs: list[Any],
    key: str,
    limits: tuple[float, float],
    label: str,
) -> None:
    """Single pairs as dots, and means with standard errors in twelve bins."""
    low, high = limits
    panel.set_title(f"ε against {label.partition(',')[0]}")
    panel.set(xlim=limits, xlabel=label, xticks=np.linspace(low, high, 7))
    _joint(panel, scale)
    shown = [pair for pair in pairs if pair.get(key) is not None]
    if not shown:
        panel.text(0.5, 0.5, "not known", transform=panel.transAxes, ha="center")
        return
    angle, epsilon = _numbers(shown, key), _numbers(shown, "epsilon") * _PPM
    used = np.array([bool(pair.get("used", True)) for pair in shown])
    panel.plot(angle[used], epsilon[used], ".", color=Colour.SPC, ms=4, alpha=0.45, label="single")
    if (~used).any():
        panel.plot(angle[~used], epsilon[~used], "x", color=Colour.REJECTED, ms=5, label="rejected")
    edges = np.linspace(low, high, 13)
    centers, means, errors = binned(angle[used], epsilon[used], edges)
    panel.errorbar(
        centers,
        means,
        errors,
        fmt="o",
        color=Colour.FUSED,
        ms=5,
        capsize=3,
        zorder=3,
        label="bin mean",
    )
    if used.any():
        # Outliers must not compress the axis.
        half = 1.6 * max(
            float(np.percentile(np.abs(epsilon[used] - np.median(epsilon[used])), 98)), 1.0
        )
        panel.set_ylim(np.median(epsilon[used]) - half, np.median(epsilon[used]) + half)
    panel.legend(loc="upper right", ncols=3, columnspacing=0.9, handletextpad=0.3, borderpad=0.1)


def binned(
    angle: FloatArray, values: FloatArray, edges: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean and standard error of `values` in each bin of `angle`; NaN error of a single value."""
    index = np.digitize(angle, edges) - 1
    kept = [k for k in range(len(edges) - 1) if (index == k).any()]
    groups = [values[index == k] for k in kept]
    means = np.array([group.mean() for group in groups])
    errors = np.array(
        [group.std(ddof=1) / np.sqrt(group.size) if group.size > 1 else np.nan for group in groups]
    )
    return (edges[:-1] + edges[1:])[kept] / 2.0, means, errors


def _joint(panel: Any, scale: Mapping[str, Any], *, label: str = "") -> None:
    """Draw the joint estimate as a line with a band of one sigma."""
    panel.set_ylabel("ε, 10⁻⁶")
    panel.grid(visible=True, axis="y")
    panel.axhline(0.0, color=Colour.GREY, lw=0.8)
    value, sigma = scale.get("epsilon"), scale.get("epsilon_sigma")
    if value is not None:
        panel.axhline(value * _PPM, color=Colour.TEXT, lw=1.2, label=label)
        if sigma is not None:
            panel.axhspan(
                (value - sigma) * _PPM, (value + sigma) * _PPM, color=Colour.TEXT, alpha=0.12, lw=0
            )


def _numbers(entries: list[Any], key: str) -> FloatArray:
    """Return the values of `key` (N,); NaN for null."""
    values = [entry.get(key) for entry in entries]
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
