"""Values of triage: what an image shows, how it fits its state, and why it is doubtful."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from fusion.stages.images.turns import Turn
from spcola.imagematching.frames.mistakes import Mistake, ViewProblem

__all__ = ["Fit", "Flag", "Likely", "Scene", "Triage", "TriageReport"]


class Scene(StrEnum):
    """What is in the frame."""

    NO_BODY = "no body"
    LIMB = "limb"
    FILLED = "filled"


class Flag(StrEnum):
    """Why an image is doubtful."""

    EMPTY = "empty"
    OVEREXPOSED = "overexposed"
    SMEARED = "smeared"
    MIRRORED = "mirrored"
    TURNED = "turned"
    OFFSET = "offset"
    UNMATCHED = "unmatched"
    NO_STATE = "no state"
    WRONG_STATE = "wrong state"
    INSIDE = "inside body"
    AWAY = "looks away"
    TINY = "below a pixel"
    NIGHT = "no sunlit ground"


@dataclass(frozen=True)
class Fit:
    """An image against the shape at its state.

    Parameters
    ----------
    turn : Turn or None
        The orientation in which the image fits; None if none fits clearly better than the others.
    correlation, given, runner_up : float
        In the best orientation at the best offset; as it is, without an offset; in the best of the
        other orientations.
    offset_px : (2,) of float
        Pixel and line by which the image is displaced from the rendering.
    overlap, overlap_given : float
        Intersection over union of the lit ground, at the best offset and without one.
    """

    turn: Turn | None
    correlation: float
    given: float
    runner_up: float
    offset_px: tuple[float, float]
    overlap: float
    overlap_given: float


@dataclass(frozen=True)
class Likely:
    """The likely reason why an image does not fit its state.

    Parameters
    ----------
    code : str
        A `spcola.imagematching.frames.mistakes.Mistake`, or ``other-image``.
    correlation : float
        Of the image with the shape at the state that it would have without the mistake.
    image : str
        Whose state fits, for ``other-image``.
    """

    code: str
    correlation: float
    image: str = ""

    @property
    def text(self) -> str:
        """The reason in words."""
        if self.image:
            return f"its state is that of another image: it fits the one of {self.image}"
        return Mistake(self.code).text


@dataclass(frozen=True)
class Triage:
    """What an image shows.

    Parameters
    ----------
    name : str
    original : str
    size : (2,) of int
        Samples and lines.
    scene : Scene
    body_share : float
        Share of the frame that shows the body: by shape and state, NaN without them.
    lit_share : float
        Share of pixels of lit ground.
    range_m, resolution_m : float
        At the frame's centre; NaN without a state. Of a line scan the resolution is that along the
        detector's line.
    phase_deg, emission_deg : float
        At the frame's centre; NaN where unknown.
    fit : Fit, optional
        Where there are state and shape, and the body is in the frame.
    corners_deg : tuple of pair
        East longitude and latitude of the frame's corners on the shape, from the upper left one on
        with the clock; NaN off the body, empty without a state or a shape.
    flags : tuple of Flag
    likely : Likely, optional
        Where another state explains the picture.
    """

    name: str
    original: str
    size: tuple[int, int]
    scene: Scene
    body_share: float
    lit_share: float
    range_m: float
    resolution_m: float
    phase_deg: float
    emission_deg: float
    fit: Fit | None
    corners_deg: tuple[tuple[float, float], ...]
    flags: tuple[Flag, ...]
    likely: Likely | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the triage in JSON types."""
        return asdict(self)

    @property
    def remark(self) -> str:
        """What is doubtful, and what to do, on one line; empty if nothing is."""
        words = [_WORDS[flag] for flag in self.flags]
        return "; ".join(one if isinstance(one, str) else one(self) for one in words)


def _turn_words(triage: Triage) -> str:
    assert triage.fit is not None
    assert triage.fit.turn is not None
    what = "is mirrored" if Flag.MIRRORED in triage.flags else "is turned"
    return (
        f"{what} against its state (correlation {triage.fit.correlation:.2f} as "
        f"{triage.fit.turn}, {triage.fit.given:.2f} as it is): remove its files and import it "
        f"with --orientation {triage.fit.turn}, or mend the state"
    )


def _offset_words(triage: Triage) -> str:
    assert triage.fit is not None
    right, down = triage.fit.offset_px
    return f"lies {right:+.1f} pixels and {down:+.1f} lines from the shape at its state"


def _state_words(triage: Triage) -> str:
    assert triage.likely is not None
    given = triage.fit.given if triage.fit is not None else 0.0
    return (
        f"does not fit its state; likely {triage.likely.text} (correlation "
        f"{triage.likely.correlation:.2f} then, {given:.2f} as it is) [{triage.likely.code}]"
    )


_WORDS: dict[Flag, str | Callable[[Triage], str]] = {
    Flag.EMPTY: "shows noise alone",
    Flag.OVEREXPOSED: "is overexposed",
    Flag.SMEARED: "has smear along whole columns or lines; --smear-s removes a frame transfer's",
    Flag.MIRRORED: _turn_words,
    Flag.TURNED: _turn_words,
    Flag.OFFSET: _offset_words,
    Flag.UNMATCHED: "looks like the shape at its state in no orientation, or in several alike",
    Flag.NO_STATE: "has no state: give --poses or --states",
    Flag.WRONG_STATE: _state_words,
    Flag.INSIDE: f"by its state {ViewProblem.INSIDE.text}",
    Flag.AWAY: f"by its state {ViewProblem.AWAY.text}",
    Flag.TINY: f"by its state {ViewProblem.TINY.text}",
    Flag.NIGHT: f"by its state {ViewProblem.NIGHT.text}",
}


@dataclass(frozen=True)
class TriageReport:
    """Triage of all images of a workspace.

    Parameters
    ----------
    images : tuple of Triage
        In the order of their names.
    """

    images: tuple[Triage, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of images by scene and by flag."""
        counts = {str(scene): sum(one.scene is scene for one in self.images) for scene in Scene}
        return counts | {str(flag): sum(flag in one.flags for one in self.images) for flag in Flag}

    @property
    def likely(self) -> dict[str, int]:
        """Numbers of images by the code of what is likely wrong with their states."""
        codes = [one.likely.code for one in self.images if one.likely is not None]
        return {code: codes.count(code) for code in sorted(set(codes))}

    @property
    def found_orientation(self) -> dict[str, int]:
        """Numbers of images by the orientation in which they fit the shape."""
        turns = [str(one.fit.turn) for one in self.images if one.fit and one.fit.turn]
        return {turn: turns.count(turn) for turn in sorted(set(turns))}

    @property
    def offset_rms_px(self) -> tuple[float, float]:
        """Root mean square of the offsets of images with an orientation, pixel and line."""
        offsets = [one.fit.offset_px for one in self.images if one.fit and one.fit.turn]
        if not offsets:
            return np.nan, np.nan
        right, down = np.sqrt(np.mean(np.square(offsets), axis=0))
        return float(right), float(down)

    def as_json(self) -> dict[str, Any]:
        """Return the report in JSON types."""
        return {
            "counts": self.counts,
            "likely": self.likely,
            "orientations": self.found_orientation,
            "offset_rms_px": list(self.offset_rms_px),
            "images": [one.as_json() for one in self.images],
        }
