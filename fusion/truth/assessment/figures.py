"""Figures that compare the models: distances, resolution, regions, calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.report.layout import Colour, styled_figure
from fusion.truth.assessment.regions import REGIONS, RegionScore
from fusion.truth.assessment.score import ModelScore

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours, which remain distinct for colour-blind readers.
_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000")
_MARKERS = "osD^vPX"


def colour(number: int) -> str:
    """Return the colour of the n-th model."""
    return _COLOURS[number % len(_COLOURS)]


def distances_figure(scores: Sequence[ModelScore], formu: float) -> Figure:
    """3D rms of every model: as given, without offset, optimised; height rms; FormU."""
    kinds: tuple[tuple[str, str, str, Callable[[ModelScore], float]], ...] = (
        ("3D rms", "o", "#cc3311", lambda s: s.distances.rms),
        ("without offset", "D", "#e69f00", lambda s: s.distances.rms_without_offset),
        ("optimised", "s", "#0072b2", lambda s: s.distances.rms_optimised),
        ("height rms, planted frame", "|", Colour.TEXT, lambda s: s.regions[0].rms),
    )
    rows = np.arange(len(scores))
    with styled_figure(9.4, 1.2 + 0.36 * len(scores)) as figure:
        panel = figure.subplots()
        for label, marker, tint, value in kinds:
            size = 13 if marker == "|" else 7
            values = [value(score) for score in scores]
            panel.plot(values, rows, marker, ms=size, color=tint, label=label, mew=1.6, alpha=0.85)
        if np.isfinite(formu):
            panel.axvline(
                formu, color=Colour.GREY, ls="--", lw=1.2, label="FormU of the SPC solution"
            )
        panel.set_yticks(rows, [score.name for score in scores])
        panel.set_ylim(len(scores) - 0.5, -0.5)
        panel.set_xlim(left=0.0)
        panel.set_xlabel("metres")
        panel.grid(visible=True)
        panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5)
    return figure


def resolution_figure(scores: Sequence[ModelScore]) -> Figure:
    """Transfer² and coherence of every model against wavelength."""
    from matplotlib.ticker import LogLocator  # noqa: PLC0415

    with styled_figure(9.4, 3.8) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for number, score in enumerate(scores):
            t = score.transfer
            if not np.isfinite(t.transfer).any():
                continue
            kept = np.sign(t.transfer) * t.transfer**2
            _curve(panels[0], t.wavelength, kept, t.half_power, (number, score.name))
            _curve(panels[1], t.wavelength, t.coherence, t.half_coherence, (number, score.name))
        titles = ("share of the truth's power in the model", "coherence with the truth")
        for panel, title in zip(panels, titles, strict=True):
            panel.set_title(title)
            panel.axhline(0.5, color=Colour.GREY, ls="--", lw=1.0)
            panel.set(xscale="log", ylim=(-0.05, 1.25), xlabel="wavelength, m")
            panel.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
            for axis in (panel.xaxis.set_major_formatter, panel.xaxis.set_minor_formatter):
                axis("{x:g}")
            panel.grid(visible=True, which="both")
        panels[0].legend(loc="upper left")
    return figure


def _curve(panel: Any, wavelength: Any, share: Any, half: float, what: tuple[int, str]) -> None:
    """Draw one curve, and a mark where it crosses one half."""
    number, name = what
    label = f"{name}: {half:.2f} m" if np.isfinite(half) else name
    panel.plot(wavelength, share, color=colour(number), lw=1.5, label=label)
    if np.isfinite(half):
        panel.plot(half, 0.5, "o", color=colour(number), ms=5)


def regions_figure(scores: Sequence[ModelScore]) -> Figure:
    """Rms of the errors of heights and slopes in each region, for every model."""
    with styled_figure(9.4, 4.6) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        _dots(panels[0], scores, lambda region: region.rms)
        _dots(panels[1], scores, lambda region: region.slope_rms_deg)
        panels[0].set(xlabel="rms height error, m", xlim=(0, None))
        panels[1].set(xlabel="rms angle between normals, °", xlim=(0, None))
        _legend(figure, panels[0], len(scores))
    return figure


def calibration_figure(scores: Sequence[ModelScore]) -> Figure | None:
    """Shares of the errors within one and two stated sigmas; None if no model states sigmas."""
    stating = [score for score in scores if np.isfinite(score.regions[0].within_1)]
    if not stating:
        return None
    order = [list(scores).index(score) for score in stating]
    with styled_figure(9.4, 4.6) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        _dots(panels[0], stating, lambda region: region.within_1, order)
        _dots(panels[0], stating, lambda region: region.within_2, order, hollow=True)
        for share in (0.6827, 0.9545):
            panels[0].axvline(share, color=Colour.GREY, ls="--", lw=1.2)
        panels[0].set(xlabel="share within 1 σ (full) and 2 σ (hollow)", xlim=(0, 1.02))
        _dots(panels[1], stating, lambda region: np.clip(region.pull_std, 0.1, 10.0), order)
        panels[1].axvline(1.0, color=Colour.GREY, ls="--", lw=1.2)
        panels[1].set(xscale="log", xlim=(0.09, 11.0))
        panels[1].set_xlabel("standard deviation of error / σ (beyond 10 at the edge)")
        panels[1].set_xticks([0.1, 0.2, 0.5, 1, 2, 5, 10])
        panels[1].xaxis.set_major_formatter("{x:g}")
        panels[1].minorticks_off()
        _legend(figure, panels[1], len(stating))
    return figure


def _dots(
    panel: Any,
    scores: Sequence[ModelScore],
    value: Callable[[RegionScore], float],
    order: Sequence[int] | None = None,
    *,
    hollow: bool = False,
) -> None:
    """Draw one row for each region and one mark for each model, slightly displaced in the row."""
    rows = np.arange(len(REGIONS))
    for place, score in enumerate(scores):
        number = place if order is None else order[place]
        shift = 0.6 * ((place + 0.5) / len(scores) - 0.5)
        panel.plot(
            [value(region) for region in score.regions], rows + shift,
            _MARKERS[number % len(_MARKERS)], ms=4.5, color=colour(number), ls="none",
            mfc="white" if hollow else colour(number), label=None if hollow else score.name,
        )  # fmt: skip
    panel.set_yticks(rows, REGIONS)
    panel.set_ylim(len(REGIONS) - 0.5, -0.5)
    panel.hlines(rows[:-1] + 0.5, *(0, 1), transform=panel.get_yaxis_transform(), color="#eeeeee")
    panel.grid(visible=True, axis="x")


def _legend(figure: Any, panel: Any, count: int) -> None:
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=min(count, 4))
