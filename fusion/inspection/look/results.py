"""Pictures of results: the registration and the scale, with their verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fusion.estimation.verdict import Severity, Verdict
from fusion.inspection.look.numbers import measured, millionths
from fusion.inspection.look.picture import Picture, set_title
from fusion.report.figures import registration_figure, scale_figure
from fusion.workspace import Workspace
from spcola.errors import FormatError

_LISTED = 3


def result_picture(path: Path) -> Picture:
    """Draw a ``registration.json`` or a ``scale.json``.

    Raises
    ------
    FormatError
        If it is neither, or lacks what is drawn.
    WorkspaceError
        If it is no JSON.
    """
    content = Workspace(path.parent).read_json(path.name)
    try:
        if "per_mapola" in content:
            return _registration(content, path.name)
        if "epsilon" in content:
            return _scale(content, path.name)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise FormatError(
            f"lacks what is drawn ({error!r})", path, "run its stage again"
        ) from error
    raise FormatError(
        "is JSON, but neither a registration nor a scale",
        path,
        "registration.json and scale.json can be drawn",
    )


def _registration(content: Mapping[str, Any], name: str) -> Picture:
    figure = registration_figure(content)
    used, left = content["n_used"], content["n_rejected"]
    numbers = [f"Model: {content['model']}", f"{used} of {used + left} mapolas used"]
    if content.get("scale") is not None:
        numbers.append(f"scale − 1: {millionths(content['scale'] - 1, content['scale_sigma'])}")
    moved = _vector(content, "translation_m", "translation_sigma_m")
    turned = _vector(content, "rotation_deg", "rotation_sigma_deg")
    lines = ["; ".join(numbers), f"Translation x, y, z, m: {moved}. Rotation, °: {turned}."]
    set_title(figure, f"{name}: {_judged(content)}", "\n".join([*lines, *_findings(content)]))
    facts = {key: content.get(key) for key in ("model", "n_used", "n_rejected", "verdict")}
    return Picture("registration", figure, facts)


def _scale(content: Mapping[str, Any], name: str) -> Picture:
    figure = scale_figure(content)
    size = measured(content.get("size_correction_m"), content.get("size_correction_sigma_m"))
    line = (
        f"ε: {millionths(content['epsilon'], content['epsilon_sigma'])}; size correction, m: "
        f"{size}; {content['n_used']} used, {content['n_rejected']} rejected"
    )
    set_title(figure, f"{name}: {_judged(content)}", "\n".join([line, *_findings(content)]))
    facts = {key: content.get(key) for key in ("epsilon", "epsilon_sigma", "n_used", "verdict")}
    return Picture("scale", figure, facts)


def _judged(content: Mapping[str, Any]) -> str:
    return str(content.get("verdict") or "without a verdict")


def _findings(content: Mapping[str, Any]) -> list[str]:
    """Return the gravest findings, one line each."""
    found = Verdict.from_json(content).findings
    grave = [one for one in found if one.severity is not Severity.NOTE]
    lines = [f"{one.severity}: {one.text} [{one.code}]" for one in grave[:_LISTED]]
    more = len(grave) - len(lines)
    return [*lines, f"and {more} more"] if more > 0 else lines


def _vector(content: Mapping[str, Any], key: str, sigma: str) -> str:
    """Return three values with their sigmas."""
    spreads = content.get(sigma) or [None] * 3
    return ", ".join(measured(v, s) for v, s in zip(content[key], spreads, strict=True))
