"""States that contradict the shape, found before anything of their images is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.stages.images.sources import Sighting
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError
from spcola.imagematching.frames.mistakes import BodyOutline, Mistake, ViewProblem

_OF_THE_FRAME = (ViewProblem.AWAY, ViewProblem.NIGHT)
# So many names are printed.
_NAMED = 3


@dataclass(frozen=True)
class StateDoubt:
    """Images whose states contradict the shape in one way.

    Parameters
    ----------
    code : ViewProblem
    images : tuple of str
    likely : tuple of Mistake
        Each of them alone would explain it for all these images.
    origins : tuple of str
        Where the states come from.
    """

    code: ViewProblem
    images: tuple[str, ...]
    likely: tuple[Mistake, ...]
    origins: tuple[str, ...]

    @property
    def text(self) -> str:
        """What is doubtful, on one line, with its code."""
        names = ", ".join(self.images[:_NAMED]) + (", …" if len(self.images) > _NAMED else "")
        many = f"{len(self.images)} images" if len(self.images) > 1 else "one image"
        return f"{many} ({names}): by the state {self.code.text} [{self.code}]"

    @property
    def cause(self) -> str:
        """The likely mistakes in words; empty if none explains it."""
        return "likely " + ", or ".join(one.text for one in self.likely) if self.likely else ""

    @property
    def line(self) -> str:
        """Both on one line."""
        return "; ".join(part for part in (self.text, self.cause) if part)

    def as_json(self) -> dict[str, Any]:
        """Return the doubt in JSON types."""
        return {
            "code": str(self.code),
            "images": list(self.images),
            "likely": [str(one) for one in self.likely],
            "text": self.line,
        }


def find_doubts(workspace: Workspace, sightings: Mapping[str, Sighting]) -> tuple[StateDoubt, ...]:
    """Return what contradicts the shape of the workspace in new states.

    Without a shape it is found only that the body's centre lies behind the camera.

    Parameters
    ----------
    workspace : Workspace
    sightings : mapping of str to Sighting
        By the name of the image.

    Raises
    ------
    InvalidValueError
        If a spacecraft lies inside the body.
    """
    images = {name: _image(name, one) for name, one in sightings.items()}
    outline = BodyOutline.of_mesh(workspace.shape()) if images and workspace.has_shape() else None
    found: dict[ViewProblem, list[str]] = {}
    for name, image in images.items():
        problem = _behind(image) if outline is None else outline.problem(image)
        # The frame of a line scan is not that of its middle line.
        scanned = sightings[name].scan is not None
        if problem is not None and not (scanned and problem in _OF_THE_FRAME):
            found.setdefault(problem, []).append(name)
    doubts = []
    for code, names in found.items():
        likely = _likely(outline, [images[name] for name in names])
        origins = dict.fromkeys(sightings[name].origin for name in names)
        doubts.append(StateDoubt(code, tuple(names), likely, tuple(origins)))
    for doubt in doubts:
        if doubt.code is ViewProblem.INSIDE:
            where = doubt.origins[0] if len(doubt.origins) == 1 else "states"
            raise InvalidValueError(doubt.text, where, doubt.cause or "mend the states")
    return tuple(doubts)


def _likely(outline: BodyOutline | None, images: Sequence[SpcImage]) -> tuple[Mistake, ...]:
    """Return the mistakes that explain what contradicts the shape in all of some images."""
    if outline is None:
        return ()
    explaining = [set(outline.mistakes(image)) for image in images]
    return tuple(one for one in Mistake if all(one in some for some in explaining))


def _image(name: str, sighting: Sighting) -> SpcImage:
    """Return state and camera of an image."""
    state = sighting.state
    return SpcImage(name, "", sighting.camera, state.scobj, state.axes, state.sun)


def _behind(image: SpcImage) -> ViewProblem | None:
    """Return that the body's centre lies behind the camera, if it does."""
    return ViewProblem.AWAY if float(np.dot(image.scobj, image.boresight)) < 0.0 else None
