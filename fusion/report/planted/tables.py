"""Tables of planted and recovered values."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from fusion.report.layout import html_table, number_text
from fusion.report.layout.html import MARKED_CELL, html_list
from fusion.report.planted.values import RecoveredParameter, SurfaceErrors

# Beyond this many sigmas a recovered number disagrees with what was planted.
_SUSPICIOUS_PULL = 3.0


def planted_table(planted: Sequence[RecoveredParameter]) -> str:
    """Return the HTML table of planted and recovered values; large pulls are marked."""
    rows = []
    for entry in planted:
        suspicious = abs(entry.pull) > _SUSPICIOUS_PULL
        pull = number_text(round(entry.pull, 2)) if np.isfinite(entry.pull) else "–"
        rows.append(
            [
                escape(entry.name) + (f", {escape(entry.unit)}" if entry.unit else ""),
                number_text(float(entry.planted), entry.sigma),
                number_text(float(entry.recovered), entry.sigma),
                number_text(float(entry.sigma), entry.sigma),
                f"{MARKED_CELL}{pull}" if suspicious else pull,
            ]
        )
    caption = "pull = (recovered − planted) / sigma; beyond 3 in red"
    shown = html_table(["", "planted", "recovered", "sigma", "pull"], rows, caption=caption)
    why = (f"{entry.name}: {entry.explanation}" for entry in planted if entry.explanation)
    return shown + html_list(f"Beyond {_SUSPICIOUS_PULL:g} sigma", why)


def errors_table(errors: Sequence[SurfaceErrors]) -> str:
    """Return the HTML table of how far each surface of a synthetic mission is from the true one."""
    rows = [
        [
            escape(one.name),
            f"{100 * one.share:.0f} %",
            *(number_text(round(m, 3)) for m in (one.within_68_m, one.within_95_m, one.rms_m)),
        ]
        for one in errors
    ]
    head = ["", "ground covered", "68 % of errors below, m", "95 % below, m", "rms, m"]
    return html_table(head, rows, caption="Heights of each surface against the true ones")
