"""Figure of accuracy and effort over the versions of a solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fusion.report.layout import Colour, styled_figure
from fusion.truth.assessment.versions.versions import VersionScore

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMES = 8


def versions_figure(found: Sequence[VersionScore]) -> Figure:
    """3D rms, optimised 3D rms and FormU over versions; below, the maplets that each changed."""
    shown = [one for one in found if one.models]
    place, nan = np.arange(len(shown)), float("nan")
    first = [one.models[0].distances for one in shown]
    formu = [nan if one.formal is None else one.formal.formu for one in shown]
    with styled_figure(9.4, 4.8) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        upper.plot(place, [d.rms for d in first], "o-", color=Colour.REJECTED, label="3D rms")
        optimised = [d.rms_optimised for d in first]
        upper.plot(place, optimised, "s-", color=Colour.SPC, label="optimised 3D rms")
        upper.plot(place, formu, "D--", color=Colour.GREY, label="FormU")
        upper.set_ylabel("metres")
        upper.set_ylim(bottom=0.0)
        upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
        lower.bar(place, [one.effort.changed.get("maplets", 0) for one in shown], color=Colour.SPC)
        for k, one in enumerate(shown):
            if one.effort.processor_s is not None:
                lower.annotate(
                    f"{one.effort.processor_s:.3g} s CPU", (k, 0.0), (0, 2), ha="center",
                    textcoords="offset points", color=Colour.TEXT, fontsize=7,
                )  # fmt: skip
        lower.set_ylabel("maplets changed")
        turned = 0 if len(shown) <= _NAMES else 40
        lower.set_xticks(
            place, [one.record.name for one in shown], rotation=turned,
            ha="right" if turned else "center",
        )  # fmt: skip
        for panel in (upper, lower):
            panel.grid(visible=True)
    return figure
