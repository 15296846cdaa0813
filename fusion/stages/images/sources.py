"""States and cameras of given images, by the source that the user chose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.stages.images.candidates import find_candidates
from fusion.stages.images.choice import StateChoice, StateKind
from fusion.stages.images.label_states import display_notes, other_state_notes
from fusion.stages.images.line_states import LineTimes, scan_of_lines
from fusion.stages.images.opened import OpenedImage
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.linescan import LineScan
from spcola.errors import InvalidValueError
from spcola.formats.solution.any_camera import read_one_instrument
from spcola.formats.states import (
    read_times,
)
from spcola.navigation import utc_from_et
from spcola.navigation.states import ImageState

__all__ = ["Sighting", "find_sightings", "stated_times"]

# Differences of a table's and a label's time that rounding explains, seconds.
_SAME_TIME_S = 1.0


@dataclass(frozen=True, eq=False)
class Sighting:
    """State and camera of one image.

    Parameters
    ----------
    state : ImageState
    camera : Camera
    thresholds : (int, int), optional
        Of the camera's .SUM file.
    origin : str
        Where the state was found.
    camera_origin : str
    rate : (3,) ndarray, optional
        Angular velocity of the body, body-fixed, rad/s: with it there is a .NOM file.
    notes : tuple of str
        What other sources give.
    scan : LineScan, optional
        States of all lines of a line-scan image; `state` is that of its middle.
    """

    state: ImageState
    camera: Camera
    thresholds: tuple[int, int] | None
    origin: str
    camera_origin: str
    rate: FloatArray | None = None
    notes: tuple[str, ...] = ()
    scan: LineScan | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Samples and lines of an image of the camera."""
        return self.camera.width, self.camera.height if self.scan is None else self.scan.height


@dataclass(frozen=True, eq=False)
class FoundSightings:
    """States of images by digest, and what does not fit together, one line each."""

    sightings: dict[str, Sighting]
    remarks: tuple[str, ...]


def find_sightings(
    workspace: Workspace, images: Sequence[OpenedImage], choice: StateChoice
) -> FoundSightings:
    """Return the states of images.

    Raises
    ------
    SpcolaError
        If the source cannot be read, does not cover an exposure, or there is no camera, or it has
        another size than an image.
    """
    if choice.kind is StateKind.NONE:
        return FoundSightings({}, ())
    instrument, thresholds = None, None
    if choice.camera is not None:
        instrument, thresholds = read_one_instrument(choice.camera)
    camera, line_times = None if instrument is None else instrument.camera, LineTimes(instrument)
    candidates, remarks = find_candidates(workspace, images, choice, line_times)
    times = {} if choice.times is None else read_times(choice.times, columns={})
    found = {}
    for image in images:
        candidate = candidates.get(image.digest)
        if candidate is None:
            remarks.append(f"{image.path}: has no state in {choice.named}; only its pixels come in")
            continue
        state, notes = _completed(candidate.state, image, times)
        used = camera or candidate.camera
        if used is None:
            raise InvalidValueError(
                f"has a state ({choice.kind}) and no camera", image.path, "give --camera FILE"
            )
        origin = str(choice.camera) if camera is not None else candidate.camera_origin
        if candidate.lines is None and line_times.are_needed(image):
            raise InvalidValueError(
                f"its lines were exposed one after the other, {choice.named} has one state of it",
                image.path,
                "give several rows of --poses, or --states that has one for each line, or import "
                "its pixels without a state",
            )
        lines = candidate.lines
        scan = None if lines is None else scan_of_lines(image, used, lines)
        found[image.digest] = Sighting(
            state, used, thresholds, str(candidate.origin), origin, candidate.rate,
            (*candidate.notes, *notes, *_label_notes(image, state, used, choice.kind)), scan,
        )  # fmt: skip
    return FoundSightings(found, tuple(remarks))


def stated_times(images: Sequence[OpenedImage], choice: StateChoice) -> dict[str, float]:
    """Return the times of images by digest, ephemeris time, s: of their labels, or of the table.

    Parameters
    ----------
    images : sequence of OpenedImage
    choice : StateChoice
        Its table of times is read.

    Raises
    ------
    FormatError
        If the table cannot be read.
    """
    table = {} if choice.times is None else read_times(choice.times, columns={})
    found = {}
    for image in images:
        given = next((table[key].time for key in image.keys if key in table), np.nan)
        time = given if image.time is None else image.time
        if np.isfinite(time):
            found[image.digest] = float(time)
    return found


def _completed(
    state: ImageState, image: OpenedImage, times: Mapping[str, tuple[float, FloatArray]]
) -> tuple[ImageState, tuple[str, ...]]:
    """Return a state with time and Sun, and a note where the label's time is another one."""
    given = next((times[key] for key in image.keys if key in times), (np.nan, np.full(3, np.nan)))
    if not np.isfinite(state.time):
        state = replace(state, time=given[0] if image.time is None else image.time)
    if not np.isfinite(state.sun).all():
        state = replace(state, sun=given[1])
    if not np.isfinite(state.time):
        raise InvalidValueError("its time is unknown", image.path, "give --times TABLE")
    if not np.isfinite(state.sun).all():
        raise InvalidValueError(
            "the direction to the Sun is unknown", image.path, "give --times TABLE with sunx …"
        )
    # The label of a cut line scan still has the time of the whole one.
    if image.time is None or image.scanner or abs(image.time - state.time) <= _SAME_TIME_S:
        return state, ()
    return state, (
        f"the label gives {utc_from_et(image.time, 3)} for the middle of the exposure, its state "
        f"{utc_from_et(state.time, 3)}",
    )


def _label_notes(
    image: OpenedImage, state: ImageState, camera: Camera, kind: StateKind
) -> tuple[str, ...]:
    """Return how far the state or the display of the label is from what is used."""
    if kind is StateKind.LABEL:
        return display_notes(image, camera)
    return other_state_notes(image, state, camera)
