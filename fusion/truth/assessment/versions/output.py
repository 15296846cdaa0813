"""Versions of a solution against the truth: as JSON, as a table of lines, and as a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from fusion.products import versions as program_versions
from fusion.report.layout import html_figure, html_page, html_table, number_text
from fusion.truth.assessment.definitions import definitions
from fusion.truth.assessment.page import definitions_table
from fusion.truth.assessment.score import ModelScore
from fusion.truth.assessment.settings import AssessmentSettings
from fusion.truth.assessment.summary import formal_json, model_json
from fusion.truth.assessment.versions.figure import versions_figure
from fusion.truth.assessment.versions.versions import VersionScore
from fusion.truth.planted import Planted
from spcola import atomic

_CAPTION = (
    "3D rms of the maplets of each version of the solution, as given and after the translation and "
    "rotation that minimise it, and FormU. Below: maplets that each version changed of its parent, "
    "and the processor time of making it where that was recorded."
)


def versions_json(
    found: Sequence[VersionScore], planted: Planted, settings: AssessmentSettings
) -> dict[str, Any]:
    """Return the content of ``assess --solution all --json``; null means unknown."""
    return {
        "definitions": definitions(settings),
        "settings": asdict(settings),
        "seed": planted.settings.seed,
        "solutions": [_version(one) for one in found],
    }


def versions_lines(found: Sequence[VersionScore]) -> Iterator[str]:
    """Yield a table of lines: the surfaces of every version, FormU and effort."""
    yield (
        f"{'solution':22}{'from':16}{'surface':14}{'3D rms':>9}{'no offset':>10}{'optimised':>10}"
        f"{'FormU':>8}{'changed':>9}{'items':>7}{'CPU, s':>9}"
    )
    for one in found:
        first = f"{one.record.name[:21]:22}{one.record.parent[:15]:16}"
        formu = _cell(None if one.formal is None else one.formal.formu, 8)
        effort = (
            f"{_count(one.effort.changed.get('maplets')):>9}{_count(one.effort.items):>7}"
            f"{_cell(one.effort.processor_s, 9, '{:.1f}')}"
        )
        for score in one.models:
            d = score.distances
            cells = _cell(d.rms, 9) + _cell(d.rms_without_offset, 10) + _cell(d.rms_optimised, 10)
            yield f"{first}{_surface(score, one)[:13]:14}{cells}{formu}{effort}"
            first, formu, effort = " " * 38, "", ""
    yield (
        "lengths in metres; changed: maplets that differ from the parent's; items: files computed; "
        "–: not recorded or not known"
    )


def write_versions_page(
    path: Path, found: Sequence[VersionScore], planted: Planted, settings: AssessmentSettings
) -> None:
    """Write the curve as one self-contained HTML page, whole or not at all.

    Raises
    ------
    WorkspaceError
        If it cannot be written.
    """
    parts = []
    if any(one.models for one in found):
        figure = html_figure(versions_figure(found), _CAPTION, "3D rms over versions")
        parts.append(("curve", "Accuracy over versions", figure + _table(found)))
    parts.append(("definitions", "Definitions", definitions_table(settings)))
    title = f"Versions of the solution: mission of seed {planted.settings.seed}"
    atomic.write_text(path, html_page(title, title, parts, program_versions()))


def _version(one: VersionScore) -> dict[str, Any]:
    record = one.record
    return {
        "solution": record.name,
        "parent": record.parent or None,
        "made_by": record.made_by,
        "made": record.made or None,
        "facts": dict(record.facts),
        "formal_uncertainty": None if one.formal is None else formal_json(one.formal),
        "effort": {
            "changed": dict(one.effort.changed) or None,
            "items": one.effort.items,
            "processor_s": one.effort.processor_s,
        },
        "models": [
            {**model_json(score, one.formal), "name": _surface(score, one)} for score in one.models
        ],
    }


def _surface(score: ModelScore, one: VersionScore) -> str:
    return score.name.removesuffix(f" of {one.record.name}")


def _table(found: Sequence[VersionScore]) -> str:
    head = ["solution", "from", "made by", "made, UTC", "surface", "3D rms, m", "without offset, m",
            "optimised, m", "FormU, m", "maplets changed", "items", "CPU, s"]  # fmt: skip
    rows = []
    for one in found:
        record, effort = one.record, one.effort
        for score in one.models:
            d = score.distances
            rows.append([
                escape(record.name), escape(record.parent), escape(record.made_by),
                escape(record.made),
                escape(_surface(score, one)), number_text(d.rms, 0.01),
                number_text(d.rms_without_offset, 0.01), number_text(d.rms_optimised, 0.01),
                number_text(float("nan") if one.formal is None else one.formal.formu, 0.01),
                _count(_maplets(effort.changed)), _count(effort.items),
                "–" if effort.processor_s is None else f"{effort.processor_s:.1f}",
            ])  # fmt: skip
    return html_table(head, rows, caption="–: not recorded")


def _maplets(changed: Mapping[str, int]) -> int | None:
    return changed.get("maplets")


def _count(value: int | None) -> str:
    return "–" if value is None else str(value)


def _cell(value: float | None, width: int, form: str = "{:.3f}") -> str:
    return f"{'–' if value is None or np.isnan(value) else form.format(value):>{width}}"
