"""Figures over the whole body: coverage, and residuals of the registration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.report.data import LidarCoverage
from fusion.report.layout import Colour, styled_figure
from spcola.arrays import FloatArray
from spcola.math import lon_lat_deg

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def coverage_figure(coverage: LidarCoverage) -> Figure:
    """Longitude and latitude of all maplets, coloured by the share that lidar covers."""
    with styled_figure(9.4, 4.6) as figure:
        draw_coverage(figure, figure.subplots(), coverage)
    return figure


def draw_coverage(figure: Any, panel: Any, coverage: LidarCoverage) -> None:
    """Draw the maplets on a map of the whole body, coloured by the share that lidar covers."""
    longitude, latitude = lon_lat_deg(coverage.centers)
    covered = np.isfinite(coverage.share)
    size = _marker_size(len(longitude))
    panel.scatter(
        longitude[~covered], latitude[~covered], s=size, facecolors="none", edgecolors=Colour.GREY,
        linewidths=0.8, label=f"no mapola ({np.count_nonzero(~covered)})",
    )  # fmt: skip
    drawn = panel.scatter(
        longitude[covered], latitude[covered], c=100 * coverage.share[covered], s=size,
        cmap="viridis", vmin=0, vmax=100, label=f"mapola ({np.count_nonzero(covered)})",
    )  # fmt: skip
    bar = figure.colorbar(drawn, ax=panel, shrink=0.85, pad=0.01)
    bar.set_label("points with a lidar height, %")
    graticule(panel)
    names, _ = panel.get_legend_handles_labels()
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(names), borderpad=0.2)


def registration_figure(registration: Mapping[str, Any]) -> Figure:
    """Residuals of the mapolas: arrows over the body, and histograms along its axes."""
    entries = [e for e in registration["per_mapola"] if _known(e)]
    with styled_figure(9.4, 7.2) as figure:
        parts: Any = figure.subfigures(2, 1, height_ratios=[1.35, 1.0])
        top, bottom = parts
        _arrows(top.subplots(), top, entries)
        _histograms(bottom.subplots(1, 3, sharey=True), entries, registration)
    return figure


def _known(entry: Mapping[str, Any]) -> bool:
    """Return whether a mapola was matched, so that it has a residual."""
    residual = entry.get("residual_m")
    return residual is not None and all(part is not None for part in residual)


def _arrows(panel: Any, figure: Any, entries: list[Mapping[str, Any]]) -> None:
    """Draw horizontal residuals as arrows, the radial ones as colours; rejected as crosses."""
    graticule(panel)
    panel.set_title("Residuals after the fit: east and north as arrows, up in colour")
    if not entries:
        panel.text(180, 0, "no mapola has a residual", ha="center")
        return
    centers = np.array([entry["center_m"] for entry in entries], dtype=np.float64)
    residual = np.array([entry["residual_m"] for entry in entries], dtype=np.float64)
    used = np.array([bool(entry["used"]) for entry in entries])
    longitude, latitude = lon_lat_deg(centers)
    east, north, up = _local(longitude, latitude, residual)
    if (~used).any():
        panel.scatter(
            longitude[~used], latitude[~used], marker="x", s=36, color=Colour.REJECTED, lw=1.6,
            zorder=4, label=f"rejected, with a residual ({np.count_nonzero(~used)})",
        )  # fmt: skip
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderpad=0.2)
    if used.any():
        reach = max(float(np.percentile(np.abs(up[used]), 95)), 1e-6)
        typical = max(float(np.sqrt(np.mean(east[used] ** 2 + north[used] ** 2))), 1e-9)
        key = float(f"{2 * typical:.1g}")
        drawn = panel.quiver(
            longitude[used], latitude[used], east[used], north[used], up[used], cmap="RdBu_r",
            clim=(-reach, reach), angles="uv", scale_units="inches", scale=typical / 0.22,
            width=0.0032, edgecolor=Colour.TEXT, linewidth=0.35, zorder=3,
        )  # fmt: skip
        panel.quiverkey(drawn, 0.86, -0.12, key, f"{key:g} m", labelpos="E", color=Colour.TEXT)
        bar = figure.colorbar(drawn, ax=panel, shrink=0.85, extend="both", pad=0.01)
        bar.set_label("residual upward, m")


def _histograms(
    panels: Any, entries: list[Mapping[str, Any]], registration: Mapping[str, Any]
) -> None:
    """Draw the residuals along the body-fixed axes, used and rejected."""
    residual = np.array([e["residual_m"] for e in entries], dtype=np.float64).reshape(-1, 3)
    used = np.array([bool(e["used"]) for e in entries], dtype=bool)
    spread = np.array(registration["residual_std_m"], dtype=np.float64)
    # Rejected mapolas may lie anywhere: the outermost bins include all beyond.
    reach = 4.0 * max(float(np.max(np.nan_to_num(spread))), 1e-3)
    edges = np.linspace(-reach, reach, 25)
    for axis, panel in enumerate(panels):
        shown = np.clip(residual[:, axis], edges[0], edges[-1])
        stacks, colours = [shown[used], shown[~used]], [Colour.SPC, Colour.REJECTED]
        panel.hist(stacks, edges, stacked=True, color=colours, label=["used", "rejected"])
        panel.axvline(0.0, color=Colour.TEXT, lw=0.8)
        for side in (-1, 1) if np.isfinite(spread[axis]) else ():
            panel.axvline(side * spread[axis], color=Colour.LIDAR, lw=1.2, ls="--")
        known = f"std {spread[axis]:.3f} m" if np.isfinite(spread[axis]) else "std unknown"
        panel.set_title(f"{'xyz'[axis]}: {known}")
        panel.set_xlabel("residual, m")
        panel.grid(visible=True, axis="y")
    panels[0].set_ylabel("mapolas")
    panels[2].legend(loc="upper right")


def _local(
    longitude: FloatArray, latitude: FloatArray, vectors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """East, north and up components of body-fixed vectors (N, 3)."""
    lon, lat = np.radians(longitude), np.radians(latitude)
    x, y, z = vectors.T
    outward = np.cos(lon) * x + np.sin(lon) * y
    east = -np.sin(lon) * x + np.cos(lon) * y
    return east, -np.sin(lat) * outward + np.cos(lat) * z, np.cos(lat) * outward + np.sin(lat) * z


def graticule(panel: Any) -> None:
    """Longitude and latitude axes of the whole body, at one scale."""
    panel.set(xlim=(0, 360), ylim=(-90, 90), aspect="equal")
    panel.set(xticks=range(0, 361, 60), yticks=range(-90, 91, 30))
    panel.set(xlabel="east longitude, °", ylabel="latitude, °")
    panel.grid(visible=True)
    for spine in panel.spines.values():
        spine.set_visible(True)


def _marker_size(count: int) -> float:
    """Area of a marker, square points, so that `count` of them fill the map but do not hide it."""
    return float(np.clip(18000.0 / max(count, 1), 4.0, 90.0))
