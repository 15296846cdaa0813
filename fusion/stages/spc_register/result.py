"""What ``spcola spc register`` found: ``image_states.json``, and lines for people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from fusion.runtime.findings import finding_lines
from fusion.stages.solution_result import SolutionResult, counted, use_line
from spcola.arrays import FloatArray
from spcola.imagematching.frames.fitting import FittedFrame

STATES_FILE = "image_states.json"
STATES_KEYS = {
    "options": "what was asked for",
    "outcomes": "number of images by outcome",
    "moved_rms_px": "rms over images, change of pixel and line of the ground in the middle",
    "correlation_start": "median over images, correlation with the rendered shape as stated",
    "correlation": "the same at the end",
    "range_ratio": "median of the ratios of new to stated distances; not 1: shape and states "
    "differ in scale, or the focal length is another",
    "range_ratio_scatter": "robust standard deviation of these ratios",
    "images[].outcome": "fitted; turned, not-settled, unlike, no-ground: the state is kept",
    "images[].correlation_start": "correlation with the rendered shape at the stated state",
    "images[].correlation": "the same at the end",
    "images[].moved_px": "change of pixel and line of the ground in the middle of the body",
    "images[].sigma_px": "their sigmas",
    "images[].nearer_m": "change of the distance to the body's centre",
    "images[].roll_deg": "turn about the boresight",
    "findings": "images whose state is kept, or not settled: code, names, what to do",
}
_NAMED, _WORST = 5, 3
# Scale between shape and states that is worth a line: this far, and this many sigmas, from 1.
_SCALE, _SCALE_SIGMAS = 1e-3, 3.0


class Placed(StrEnum):
    """How the fit of a state ended."""

    FITTED = "fitted"
    NOT_SETTLED = "not-settled"
    """The state still changed in the last step."""
    TURNED = "turned"
    """The image fits the shape clearly better mirrored, or turned by quarter turns."""
    UNLIKE = "unlike"
    """The image does not look like the shape near its state, or as much elsewhere."""
    NO_GROUND = "no-ground"
    """No, or too little, lit ground of the shape is in the frame."""


_WHAT_TO_DO: Mapping[Placed, str] = {
    Placed.TURNED: "they keep their states; mirrored or turned they look like the shape: bring "
    "their pixels again, spcola images --orientation",
    Placed.NOT_SETTLED: "they keep their states; see what they show: spcola images --report",
    Placed.UNLIKE: "they keep their states; see what they show: spcola images --report",
    Placed.NO_GROUND: "they keep their states; see what they show: spcola images --report",
}


@dataclass(frozen=True, eq=False)
class Placement:
    """The fit of one image.

    Parameters
    ----------
    name : str
    outcome : Placed
    correlation_start : float
        With the rendered shape, at the stated state; of coarse cells where the state is kept.
    distance_m : float
        From the stated position to the body's centre.
    fitted : FittedFrame or None
        None where the state is kept.
    """

    name: str
    outcome: Placed
    correlation_start: float
    distance_m: float
    fitted: FittedFrame | None

    def as_json(self) -> dict[str, Any]:
        """Return the content in JSON types."""
        fitted = self.fitted
        start = self.correlation_start
        content: dict[str, Any] = {
            "outcome": str(self.outcome),
            "correlation_start": start if np.isfinite(start) else None,
            **dict.fromkeys(("correlation", "moved_px", "sigma_px", "nearer_m", "roll_deg")),
        }
        if fitted is not None:
            content |= {
                "correlation": fitted.correlation,
                "moved_px": list(fitted.moved_px),
                "sigma_px": list(fitted.sigma_px),
                "nearer_m": fitted.nearer_m,
                "roll_deg": float(np.degrees(fitted.roll)),
            }
        return content


class StatesResult(SolutionResult):
    """A new solution with states of images that fit the shape.

    `content` is of ``image_states.json``.
    """

    def lines(self) -> list[str]:
        """Return the lines to print."""
        found = self.content
        lines = [f"solution {self.solution}, from {self.parent}: states of images, {self.counts}"]
        if found["moved_rms_px"] is not None:
            pixel, line = found["moved_rms_px"]
            lines.append(
                f"  moved by {pixel:.2f} pixels and {line:.2f} lines rms; correlation with the "
                f"shape {found['correlation_start']:.3f} → {found['correlation']:.3f} (medians)"
            )
            lines += _scale_line(found)
            lines += _worst_line(found)
        lines += finding_lines(found["findings"])
        return [*lines, use_line(self.folder)]


def _scale_line(found: Mapping[str, Any]) -> list[str]:
    """Return a line where the body is larger or smaller in most images than as stated."""
    excess, scatter = found["range_ratio"] - 1.0, found["range_ratio_scatter"]
    fitted = sum(one["correlation"] is not None for one in found["images"].values())
    if abs(excess) < max(_SCALE, _SCALE_SIGMAS * scatter / np.sqrt(fitted)):
        return []
    return [
        f"  distances changed by {excess:+.2%} (scatter {scatter:.2%}): shape and states differ in "
        "scale, or the focal length is another"
    ]


def _worst_line(found: Mapping[str, Any]) -> list[str]:
    """Return a line of the images that correlate least."""
    scores = sorted(
        (one["correlation"], name)
        for name, one in found["images"].items()
        if one["correlation"] is not None
    )
    if len(scores) <= _NAMED:
        return []
    worst = ", ".join(f"{name} {score:.2f}" for score, name in scores[:_WORST])
    return [f"  least correlations: {worst}"]


def content_of(found: list[Placement], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of ``image_states.json``.

    Parameters
    ----------
    found : list of Placement
    options : mapping
        In JSON types.
    """
    fits = [(one, one.fitted) for one in found if one.fitted is not None]
    moved = np.array([fit.moved_px for _, fit in fits]).reshape(-1, 2)
    ratios = np.array([1.0 + fit.nearer_m / one.distance_m for one, fit in fits])
    middle = _median(ratios)
    scatter = None if middle is None else float(1.4826 * np.median(np.abs(ratios - middle)))
    return {
        "options": dict(options),
        "outcomes": counted(one.outcome for one in found),
        "moved_rms_px": np.sqrt(np.mean(moved**2, axis=0)).tolist() if len(moved) else None,
        "correlation_start": _median(np.array([one.correlation_start for one, _ in fits])),
        "correlation": _median(np.array([fit.correlation for _, fit in fits])),
        "range_ratio": middle,
        "range_ratio_scatter": scatter,
        "images": {one.name: one.as_json() for one in found},
        "findings": [
            {"code": str(code), "names": names, "do": do}
            for code, do in _WHAT_TO_DO.items()
            if (names := [one.name for one in found if one.outcome is code])
        ],
    }


def _median(values: FloatArray) -> float | None:
    return float(np.median(values)) if values.size else None
