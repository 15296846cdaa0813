"""Tables of the report: numbers with their sigmas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from fusion.estimation.verdict import JUDGEMENTS, Code, Finding, Severity
from fusion.report.data import ReportData
from fusion.report.layout import html_table, number_text
from fusion.report.layout.html import TEXT_CELL, html_list

# Coverage and correlation are printed to two digits.
_SHARE = 0.1
_MOST_ROWS = 40


def verdicts_box(data: ReportData) -> str:
    """Return the verdicts with the findings against using the results; "" if there is no verdict.

    Notes on what is weakly determined are shown with their numbers, except that the lidar fits in
    another frame: a reader needs that first.
    """
    rows = []
    for stage, verdict in data.verdicts.items():
        grave = [
            one
            for one in verdict.findings
            if one.severity is not Severity.NOTE or one.code is Code.FITS_OTHERWISE
        ]
        found = "".join(f"<li>{_finding(one, data.accepted)}</li>" for one in grave)
        listed = f'<ul class="reasons">{found}</ul>' if found else ""
        rows.append(f"<p><strong>{escape(stage)}: {verdict.judgement}</strong></p>{listed}")
    if not rows:
        return ""
    worst = max((v.judgement for v in data.verdicts.values()), key=JUDGEMENTS.index)
    return f'<div class="verdict {worst}">{"".join(rows)}</div>'


def _finding(finding: Finding, accepted: Sequence[str]) -> str:
    """Return one finding with its code, and whether the user accepted it."""
    word = ", accepted" if finding.code in accepted else ""
    return f"{escape(finding.text)} <code>[{finding.code}{word}]</code>"


def registration_tables(registration: Mapping[str, Any]) -> str:
    """Return tables of the transform and of the residuals of the fit."""
    rows = [
        *_rows("scale − 1, 10⁻⁶", registration, "scale", offset=-1.0, factor=1e6),
        *_rows("rotation {}, °", registration, "rotation", "deg"),
        *_rows("translation {}, m", registration, "translation", "m"),
    ]
    model = escape(str(registration.get("model", "?")))
    transform = html_table(["", "value", "sigma"], rows, caption=f"Transform, model: {model}")
    spread = registration.get("residual_std_m") or [None] * 3
    fit = [[f"residual std {axis}, m", number_text(value)]
           for axis, value in zip("xyz", spread, strict=True)]  # fmt: skip
    fit += [["mapolas used", number_text(registration.get("n_used"))],
            ["mapolas rejected", number_text(registration.get("n_rejected"))]]  # fmt: skip
    return f'<div class="tables">{transform}{html_table(["", "value"], fit, caption="Fit")}</div>'


def checks_table(registration: Mapping[str, Any]) -> str:
    """Return the table of tests of the fit, and the list of weakly determined parameters."""
    rows = []
    names = {"strain": "shear and non-uniform scale", "scale": "scale against 1"}
    for key, test in (registration.get("tests") or {}).items():
        if test:
            squares = f"{number_text(test.get('chi2'), 1.0)} of {test.get('degrees_of_freedom')}"
            why = f"{TEXT_CELL}{escape(str(test.get('reason') or ''))}"
            rows.append([names.get(key, escape(key)), squares, _chance(test.get("p_value")), why])
    for name in (registration.get("stability") or {}).get("suspect_regions") or []:
        why = f"{TEXT_CELL}without it the transform changes by more than its sigmas allow"
        rows.append([escape(str(name)), "", "", why])
    caption = "Checks: χ² of its degrees of freedom, and the probability of a larger one"
    shown = html_table(["", "χ²", "p", ""], rows, caption=caption) if rows else ""
    return shown + html_list("Weakly determined", map(str, registration.get("reasons") or ()))


def _chance(p_value: Any) -> str:
    """Return a probability: three digits, or a power of ten."""
    if p_value is None:
        return "–"
    return f"{p_value:.3f}" if p_value >= 1e-3 else f"{p_value:.0e}"


def rejected_table(registration: Mapping[str, Any]) -> str:
    """Return the table of mapolas that were not used, with the reasons."""
    left = [entry for entry in registration["per_mapola"] if not entry.get("used")]
    if not left:
        return "<p>Every mapola was used.</p>"
    rows = [
        [
            escape(str(entry["name"])),
            number_text(entry.get("coverage"), _SHARE),
            number_text(entry.get("correlation"), _SHARE),
            f"{TEXT_CELL}{escape(str(entry.get('reason') or 'not stated'))}",
        ]
        for entry in left[:_MOST_ROWS]
    ]
    further = len(left) - _MOST_ROWS
    more = f"; {further} more are in registration.json" if further > 0 else ""
    caption = f"{len(left)} mapolas not used{more}"
    return html_table(["mapola", "coverage", "correlation", "reason"], rows, caption=caption)


def scale_tables(scale: Mapping[str, Any]) -> str:
    """Return the table of the scale's numbers and the list of parameters not observed."""
    rows = [
        *_rows("ε, 10⁻⁶", scale, "epsilon", factor=1e6),
        *_rows("size correction, m", scale, "size_correction", "m"),
        *_rows("centre offset {}, m", scale, "center_offset", "m"),
        *_rows("prime meridian, °", scale, "prime_meridian", "deg"),
    ]
    notes = html_list("Not observed, or not separately", map(str, scale.get("reasons") or ()))
    return html_table(["", "value", "sigma"], rows, caption="Joint fit") + notes


def _rows(
    label: str,
    content: Mapping[str, Any],
    key: str,
    unit: str = "",
    *,
    offset: float = 0.0,
    factor: float = 1.0,
) -> list[list[str]]:
    """Return the row of label, value and sigma of a number; three if the label has {} for an axis.

    Values are ``(number + offset) * factor``; keys end in the unit, those of sigmas in ``_sigma``
    before it.
    """
    tail = f"_{unit}" if unit else ""
    value, sigma = content.get(f"{key}{tail}"), content.get(f"{key}_sigma{tail}")
    axes = "xyz" if "{}" in label else " "
    values = [value] if axes == " " else value or [None] * 3
    sigmas = [sigma] if axes == " " else sigma or [None] * 3
    rows = []
    for axis, one, spread in zip(axes, values, sigmas, strict=True):
        shown = None if one is None else (float(one) + offset) * factor
        error = None if spread is None else float(spread) * factor
        rows.append([label.format(axis), number_text(shown, error), number_text(error, error)])
    return rows
