"""Tables of the report: numbers with their sigmas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from fusion.report.data import ReportData
from fusion.report.recovered import Recovered, SurfaceErrors
from fusion.verdict import JUDGEMENTS, Code, Finding, Severity

# Beyond this many sigmas a recovered number disagrees with what was planted.
_SUSPICIOUS_PULL = 3.0
# Marks at the start of a cell: text, and a highlighted number.
_TEXT, _OFF = "\x00", "\x01"
# Coverage and correlation are printed to two digits.
_SHARE = 0.1


def number(value: Any, sigma: Any = None) -> str:
    """Return a number to two digits of its sigma, or to six digits; a dash where unknown."""
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "–"
    if isinstance(value, str | bool | int):
        return escape(str(value))
    if sigma is None or not np.isfinite(sigma) or sigma <= 0:
        return _typeset(f"{value:.6g}")
    decimals = max(0, 1 - int(np.floor(np.log10(sigma))))
    return _typeset(f"{value:.{decimals}f}" if decimals <= 9 else f"{value:.3e}")


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, caption: str = "") -> str:
    """Return an HTML table; the first cell of each row is its heading. Cells are HTML."""
    title = f"<caption>{caption}</caption>" if caption else ""
    heads = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join(
        f"<tr><th>{row[0]}</th>{''.join(_cell(cell) for cell in row[1:])}</tr>" for row in rows
    )
    return (
        f'<div class="wide"><table>{title}<thead><tr>{heads}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


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
    rows = [_row("scale − 1, 10⁻⁶", _minus_one(registration.get("scale")),
                 registration.get("scale_sigma"), factor=1e6)]  # fmt: skip
    for key, label in (("rotation", "rotation {} , °"), ("translation", "translation {} , m")):
        unit = "deg" if key == "rotation" else "m"
        values = _three(registration.get(f"{key}_{unit}"))
        sigmas = _three(registration.get(f"{key}_sigma_{unit}"))
        rows += [
            _row(label.format(axis).replace(" ,", ","), value, sigma)
            for axis, value, sigma in zip("xyz", values, sigmas, strict=True)
        ]
    model = escape(str(registration.get("model", "?")))
    transform = table(["", "value", "sigma"], rows, caption=f"Transform, model: {model}")
    spread = _three(registration.get("residual_std_m"))
    fit = [[f"residual std {axis}, m", number(value)]
           for axis, value in zip("xyz", spread, strict=True)]  # fmt: skip
    fit += [["mapolas used", number(registration.get("n_used"))],
            ["mapolas rejected", number(registration.get("n_rejected"))]]  # fmt: skip
    return f'<div class="tables">{transform}{table(["", "value"], fit, caption="Fit")}</div>'


def checks_table(registration: Mapping[str, Any]) -> str:
    """Return the table of tests of the fit, and the list of weakly determined parameters."""
    rows = []
    names = {"strain": "shear and non-uniform scale", "scale": "scale against 1"}
    for key, test in (registration.get("tests") or {}).items():
        if test:
            squares = f"{number(test.get('chi2'), 1.0)} of {test.get('degrees_of_freedom')}"
            why = f"{_TEXT}{escape(str(test.get('reason') or ''))}"
            rows.append([names.get(key, escape(key)), squares, _chance(test.get("p_value")), why])
    for name in (registration.get("stability") or {}).get("suspect_regions") or []:
        why = f"{_TEXT}without it the transform changes by more than its sigmas allow"
        rows.append([escape(str(name)), "", "", why])
    caption = "Checks: χ² of its degrees of freedom, and the probability of a larger one"
    shown = table(["", "χ²", "p", ""], rows, caption=caption) if rows else ""
    return shown + _noted("Weakly determined", registration.get("reasons") or [])


def _chance(p_value: Any) -> str:
    """Return a probability: three digits, or a power of ten."""
    if p_value is None:
        return "–"
    return f"{p_value:.3f}" if p_value >= 1e-3 else f"{p_value:.0e}"


def rejected_table(registration: Mapping[str, Any], *, most: int = 40) -> str:
    """Return the table of mapolas that were not used, with the reasons."""
    left = [entry for entry in registration["per_mapola"] if not entry.get("used")]
    if not left:
        return "<p>Every mapola was used.</p>"
    rows = [
        [
            escape(str(entry["name"])),
            number(entry.get("coverage"), _SHARE),
            number(entry.get("correlation"), _SHARE),
            f"{_TEXT}{escape(str(entry.get('reason') or 'not stated'))}",
        ]
        for entry in left[:most]
    ]
    more = f"; {len(left) - most} more are in registration.json" if len(left) > most else ""
    caption = f"{len(left)} mapolas not used{more}"
    return table(["mapola", "coverage", "correlation", "reason"], rows, caption=caption)


def scale_tables(scale: Mapping[str, Any]) -> str:
    """Return the table of the scale's numbers and the list of parameters not observed."""
    rows = [_row("ε, 10⁻⁶", scale.get("epsilon"), scale.get("epsilon_sigma"), factor=1e6)]
    rows += [_row("size correction, m", scale.get("size_correction_m"),
                  scale.get("size_correction_sigma_m"))]  # fmt: skip
    offsets = _three(scale.get("center_offset_m"))
    sigmas = _three(scale.get("center_offset_sigma_m"))
    rows += [
        _row(f"centre offset {axis}, m", value, sigma)
        for axis, value, sigma in zip("xyz", offsets, sigmas, strict=True)
    ]
    rows += [_row("prime meridian, °", scale.get("prime_meridian_deg"),
                  scale.get("prime_meridian_sigma_deg"))]  # fmt: skip
    notes = _noted("Not observed, or not separately", scale.get("reasons") or [])
    return table(["", "value", "sigma"], rows, caption="Joint fit") + notes


def _noted(heading: str, reasons: Mapping[str, Any] | Sequence[Any]) -> str:
    """Return a heading and a list of reasons; "" if there is none."""
    items = reasons.items() if isinstance(reasons, Mapping) else ((None, text) for text in reasons)
    listed = "".join(
        f"<li>{escape(f'{key}: {text}' if key else str(text))}</li>" for key, text in items
    )
    return f'<h3>{heading}</h3><ul class="reasons">{listed}</ul>' if listed else ""


def planted_table(planted: Sequence[Recovered]) -> str:
    """Return the table of planted and recovered values; large pulls are marked."""
    rows = []
    for entry in planted:
        suspicious = abs(entry.pull) > _SUSPICIOUS_PULL
        pull = number(round(entry.pull, 2)) if np.isfinite(entry.pull) else "–"
        rows.append(
            [
                escape(entry.name) + (f", {escape(entry.unit)}" if entry.unit else ""),
                number(float(entry.planted), entry.sigma),
                number(float(entry.recovered), entry.sigma),
                number(float(entry.sigma), entry.sigma),
                f"{_OFF}{pull}" if suspicious else pull,
            ]
        )
    caption = "pull = (recovered − planted) / sigma; beyond 3 in red"
    why = {entry.name: entry.explanation for entry in planted if entry.explanation}
    shown = table(["", "planted", "recovered", "sigma", "pull"], rows, caption=caption)
    return shown + _noted(f"Beyond {_SUSPICIOUS_PULL:g} sigma", why)


def errors_table(errors: Sequence[SurfaceErrors]) -> str:
    """Table of how far each surface is from the true one, in a synthetic mission."""
    rows = [
        [
            escape(one.name),
            f"{100 * one.share:.0f} %",
            *(number(round(size, 3)) for size in (one.within_68_m, one.within_95_m, one.rms_m)),
        ]
        for one in errors
    ]
    head = ["", "ground covered", "68 % of errors below, m", "95 % below, m", "rms, m"]
    return table(head, rows, caption="Heights of each surface against the true ones")


def _row(label: str, value: Any, sigma: Any, *, factor: float = 1.0) -> list[str]:
    """Return a row of label, value and sigma, both times `factor`."""
    value = None if value is None else float(value) * factor
    sigma = None if sigma is None else float(sigma) * factor
    return [label, number(value, sigma), number(sigma, sigma)]


def _cell(cell: str) -> str:
    """Return one cell; a leading mark selects text, or a highlighted number."""
    if cell.startswith(_TEXT):
        return f'<td class="text">{cell[1:]}</td>'
    if cell.startswith(_OFF):
        return f'<td class="off">{cell[1:]}</td>'
    return f"<td>{cell}</td>"


def _three(values: Any) -> list[Any]:
    """Return three values; three None if there are none."""
    return [None] * 3 if values is None else list(values)


def _minus_one(scale: Any) -> float | None:
    return None if scale is None else float(scale) - 1.0


def _typeset(text: str) -> str:
    """Return a number with a true minus sign."""
    return text.replace("-", "−")
