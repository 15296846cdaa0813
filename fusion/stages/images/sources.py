"""States and cameras of given images, by the source that the user chose."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from fusion.stages.images.label_states import (
    display_notes,
    label_camera,
    label_state,
    other_state_notes,
)
from fusion.stages.images.opened import OpenedImage
from fusion.stages.states import SourceOptions, states_by_kernels, states_by_poses
from fusion.stages.states.source import stated_spin
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.linescan import LineScan
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.cameras import read_colmap_cameras, read_isd
from spcola.formats.solution.any_camera import read_camera
from spcola.formats.states import (
    Exposure,
    read_colmap,
    read_isd_states,
    read_times,
)
from spcola.navigation import utc_from_et
from spcola.navigation.states import ImageState
from spcola.spice.states import SpiceCamera

__all__ = ["StateChoice", "StateKind", "find_sightings", "stated_times"]

# Differences of a table's and a label's time that rounding explains, seconds.
_SAME_TIME_S = 1.0
_ISD_ENDINGS = (".isd", ".json", ".ISD", ".JSON")


class StateKind(StrEnum):
    """Where the states of images come from."""

    NONE = ""
    POSES = "poses"
    SPICE = "spice"
    LABEL = "label"
    ISD = "isd"
    COLMAP = "colmap"


@dataclass(frozen=True, eq=False)
class StateChoice:
    """The source of states and cameras.

    Parameters
    ----------
    kind : StateKind
    path : Path, optional
        The table of poses, the folder of ISD files (that of the images if not given), or that of
        the COLMAP model.
    camera : Path, optional
        Camera file or .SUM file; needed unless the source has cameras.
    times : Path, optional
        Table of times and directions to the Sun (:func:`spcola.formats.states.read_times`).
    columns : mapping of str to str
        For names of columns, those in the table of poses.
    pck : Path, optional
        With the rotation for poses and labels along J2000.
    kernels : SourceOptions
    frame : SpiceCamera, optional
        The camera in the kernels.
    unit : {"km", "m"}
        Of the COLMAP model.
    first_pixel : float
        Coordinate of the first pixel's centre in the COLMAP model.
    """

    kind: StateKind = StateKind.NONE
    path: Path | None = None
    camera: Path | None = None
    times: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    pck: Path | None = None
    kernels: SourceOptions = field(default_factory=SourceOptions)
    frame: SpiceCamera | None = None
    unit: str = "km"
    first_pixel: float = 0.5


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


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A state with what else its source gives; of lines: times, positions and axes."""

    state: ImageState
    origin: Path
    rate: FloatArray | None = None
    camera: Camera | None = None
    camera_origin: str = ""
    lines: tuple[FloatArray, FloatArray, FloatArray] | None = None
    notes: tuple[str, ...] = ()


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
    for image in images:
        if image.scanner and choice.kind not in (StateKind.LABEL, StateKind.ISD):
            raise InvalidValueError(
                f"is of a line scanner: {_named(choice)} has one state, not one for each line",
                image.path,
                "take --states label or isd, or import its pixels without --states",
            )
    candidates, remarks = _FINDERS[choice.kind](workspace, images, choice)
    camera, thresholds = (None, None) if choice.camera is None else read_camera(choice.camera)
    times = {} if choice.times is None else read_times(choice.times, columns={})
    found = {}
    for image in images:
        candidate = candidates.get(image.digest)
        if candidate is None:
            remarks.append(
                f"{image.path}: has no state in {_named(choice)}; only its pixels come in"
            )
            continue
        state, notes = _completed(candidate.state, image, times)
        used = camera or candidate.camera
        if used is None:
            raise InvalidValueError(
                f"has a state ({choice.kind}) and no camera", image.path, "give --camera FILE"
            )
        origin = str(choice.camera) if camera is not None else candidate.camera_origin
        scan = None if candidate.lines is None else LineScan(used, *candidate.lines)
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


def _matched(
    images: Sequence[OpenedImage], states: Mapping[str, _Candidate], where: Path
) -> tuple[dict[str, _Candidate], list[str]]:
    """Return candidates by digest, and remarks about states without an image."""
    found = {}
    used = set()
    for image in images:
        names = [key for key in image.keys if key in states]
        if names:
            found[image.digest] = states[names[0]]
            used.update(names)
    left = [name for name in states if name not in used]
    if not left:
        return found, []
    shown = ", ".join(left[:3]) + (", …" if len(left) > 3 else "")
    has = "states have" if len(left) > 1 else "state has"
    return found, [f"{where}: {len(left)} {has} no image among the files given, left out: {shown}"]


_Found = tuple[dict[str, _Candidate], list[str]]


def _by_poses(workspace: Workspace, images: Sequence[OpenedImage], choice: StateChoice) -> _Found:
    """Return states of a table of poses."""
    assert choice.path is not None
    found = states_by_poses(
        workspace, choice.path, columns=choice.columns, pck=choice.pck, body=choice.kernels.body
    )
    candidates = {state.name: _Candidate(state, choice.path) for state in found.states}
    return _matched(images, candidates, choice.path)


def _by_kernels(workspace: Workspace, images: Sequence[OpenedImage], choice: StateChoice) -> _Found:
    """Return states by SPICE at the labels' times."""
    assert choice.frame is not None
    exposures = []
    for image in images:
        if image.time is None:
            raise FormatError(
                "the label does not state when it was exposed", image.path, "give --poses"
            )
        exposures.append(Exposure(str(image.path), image.time))
    found = states_by_kernels(workspace, exposures, choice.kernels, choice.frame)
    rates = found.body_rates if found.body_rates is not None else [None] * len(images)
    kernels = Path(", ".join(path.name for path in choice.kernels.kernels) or "[spice] kernels")
    return {
        image.digest: _Candidate(state, kernels, rate)
        for image, state, rate in zip(images, found.states, rates, strict=True)
    }, []


def _by_labels(workspace: Workspace, images: Sequence[OpenedImage], choice: StateChoice) -> _Found:
    """Return the states in the labels of ISIS cubes, PDS3 and PDS4, and the cameras known."""
    spin = stated_spin(workspace, choice.pck, choice.kernels.body)
    found = {}
    for image in images:
        label = label_state(image, spin)
        camera = None if choice.camera is not None else label_camera(image)
        found[image.digest] = _Candidate(
            label.state, image.path, None, camera, str(image.path), label.lines, label.notes
        )
    return found, []


def _by_isd(workspace: Workspace, images: Sequence[OpenedImage], choice: StateChoice) -> _Found:
    """Return states and cameras of ISD files next to the images, or in a folder."""
    del workspace
    found = {}
    for image in images:
        folder = choice.path or image.path.parent
        paths = [folder / f"{image.path.stem}{ending}" for ending in _ISD_ENDINGS]
        path = next((path for path in paths if path.is_file()), None)
        if path is None:
            continue
        sensor = read_isd(path)
        middle = len(sensor.times) // 2
        state = read_isd_states(path).state(image.path.stem, float(sensor.times[middle]))
        state = replace(state, scobj=-sensor.positions[middle], axes=sensor.axes[middle])
        lines = (sensor.times, sensor.positions, sensor.axes) if middle else None
        found[image.digest] = _Candidate(state, path, None, sensor.camera, str(path), lines)
    return found, []


def _by_colmap(workspace: Workspace, images: Sequence[OpenedImage], choice: StateChoice) -> _Found:
    """Return states and cameras of a COLMAP model."""
    del workspace
    assert choice.path is not None
    file = choice.path / "cameras.bin"
    cameras = read_colmap_cameras(file, first_pixel=choice.first_pixel) if file.is_file() else {}
    unit = "km" if choice.unit == "km" else "m"
    candidates = {
        state.name: _Candidate(state, choice.path, None, cameras.get(number), str(file))
        for state, number in read_colmap(choice.path, unit=unit)  # type: ignore[arg-type]
    }
    return _matched(images, candidates, choice.path)


_FINDERS: dict[StateKind, Callable[[Workspace, Sequence[OpenedImage], StateChoice], _Found]] = {
    StateKind.POSES: _by_poses,
    StateKind.SPICE: _by_kernels,
    StateKind.LABEL: _by_labels,
    StateKind.ISD: _by_isd,
    StateKind.COLMAP: _by_colmap,
}


def _named(choice: StateChoice) -> str:
    """Return the source in words."""
    return f"{choice.path}" if choice.path is not None else f"the files of --states {choice.kind}"
