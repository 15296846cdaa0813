"""States that each source has for given images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from fusion.stages.images.choice import StateChoice, StateKind
from fusion.stages.images.label_states import label_camera, label_state
from fusion.stages.images.line_states import Lines, LineTimes, lines_from, lines_from_states
from fusion.stages.images.opened import OpenedImage
from fusion.stages.states import states_by_kernels
from fusion.stages.states.source import stated_spin
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.cameras import read_colmap_cameras, read_isd
from spcola.formats.states import Exposure, read_colmap, read_isd_states, read_poses
from spcola.navigation.states import ImageState

Found = TypeVar("Found")
_ISD_ENDINGS = (".isd", ".json", ".ISD", ".JSON")


def isd_file(image: Path, folder: Path | None = None) -> Path | None:
    """Return the ISD file of an image, in a folder or next to it; None if there is none."""
    named = (folder or image.parent) / image.stem
    paths = (named.with_name(f"{named.name}{ending}") for ending in _ISD_ENDINGS)
    return next((path for path in paths if path.is_file()), None)


def images_among(paths: Sequence[Path], choice: StateChoice) -> list[Path]:
    """Return the images among files that are given together with their ISD files.

    Raises
    ------
    InvalidValueError
        If an ISD file is that of no image.
    """
    if choice.kind is not StateKind.ISD or choice.path is not None:
        return list(paths)
    images = [path for path in paths if path.suffix not in _ISD_ENDINGS]
    stems = {path.with_suffix("") for path in images}
    for path in paths:
        if path.with_suffix("") not in stems:
            raise InvalidValueError(
                "is the ISD file of no image that is given", path, "name it as its image"
            )
    return images


@dataclass(frozen=True, eq=False)
class Candidate:
    """A state with what else its source gives."""

    state: ImageState
    origin: Path
    rate: FloatArray | None = None
    camera: Camera | None = None
    camera_origin: str = ""
    lines: Lines | None = None
    notes: tuple[str, ...] = ()


def find_candidates(
    workspace: Workspace,
    images: Sequence[OpenedImage],
    choice: StateChoice,
    line_times: LineTimes,
) -> tuple[dict[str, Candidate], list[str]]:
    """Return the states of images by digest, and remarks about states without an image.

    Raises
    ------
    SpcolaError
        If the source cannot be read, or does not cover an exposure.
    """
    return _FINDERS[choice.kind](workspace, images, choice, line_times)


def _matched(
    images: Sequence[OpenedImage], states: Mapping[str, Found], where: Path
) -> tuple[dict[str, Found], list[str]]:
    """Return what images have, by digest, and remarks about states without an image."""
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


_Found = tuple[dict[str, Candidate], list[str]]


def _by_poses(
    workspace: Workspace,
    images: Sequence[OpenedImage],
    choice: StateChoice,
    line_times: LineTimes,
) -> _Found:
    """Return states of a table of poses."""
    assert choice.path is not None
    spin = stated_spin(workspace, choice.pck, choice.kernels.body)
    rows = read_poses(choice.path, columns=choice.columns, spin=spin)
    found, remarks = _matched(images, rows, choice.path)
    candidates = {}
    for image in images:
        if (one := found.get(image.digest)) is None:
            continue
        if len(one.states) == 1 or not line_times.are_needed(image):
            candidates[image.digest] = Candidate(one.only(), choice.path)
            continue
        along = one.along(image.size[1], partial(line_times.of, image))
        lines = lines_from(one.states, *along)
        candidates[image.digest] = Candidate(lines.middle, choice.path, lines=lines)
    return candidates, remarks


def _by_kernels(
    workspace: Workspace,
    images: Sequence[OpenedImage],
    choice: StateChoice,
    line_times: LineTimes,
) -> _Found:
    """Return states by SPICE at the labels' times, or at those of the lines."""
    assert choice.frame is not None
    read = partial(states_by_kernels, workspace, options=choice.kernels, camera=choice.frame)
    kernels = Path(", ".join(path.name for path in choice.kernels.kernels) or "[spice] kernels")
    candidates, exposures = {}, {}
    for image in images:
        if line_times.are_needed(image):
            times = line_times.of(image)
            of_lines = read([Exposure(str(image.path), float(time)) for time in times])
            lines = lines_from_states(of_lines.states)
            candidates[image.digest] = Candidate(lines.middle, kernels, lines=lines)
            continue
        if image.time is None:
            raise FormatError(
                "the label does not state when it was exposed", image.path, "give --poses"
            )
        exposures[image.digest] = Exposure(str(image.path), image.time)
    if exposures:
        found = read(list(exposures.values()))
        assert found.body_rates is not None
        for digest, state, rate in zip(exposures, found.states, found.body_rates, strict=True):
            candidates[digest] = Candidate(state, kernels, rate)
    return candidates, []


def _by_labels(
    workspace: Workspace,
    images: Sequence[OpenedImage],
    choice: StateChoice,
    line_times: LineTimes,
) -> _Found:
    """Return the states in the labels of ISIS cubes, PDS3 and PDS4, and the cameras known."""
    spin = stated_spin(workspace, choice.pck, choice.kernels.body)
    found = {}
    for image in images:
        label = label_state(image, spin, line_times)
        camera, assumed = (None, ()) if choice.camera is not None else label_camera(image)
        found[image.digest] = Candidate(
            label.state, image.path, None, camera, str(image.path), label.lines,
            (*label.notes, *assumed),
        )  # fmt: skip
    return found, []


def _by_isd(
    workspace: Workspace,
    images: Sequence[OpenedImage],
    choice: StateChoice,
    line_times: LineTimes,
) -> _Found:
    """Return states and cameras of ISD files next to the images, or in a folder."""
    del workspace, line_times
    found = {}
    for image in images:
        path = isd_file(image.path, choice.path)
        if path is None:
            continue
        sensor = read_isd(path)
        middle = len(sensor.times) // 2
        state = read_isd_states(path).state(image.path.stem, float(sensor.times[middle]))
        state = replace(state, scobj=-sensor.positions[middle], axes=sensor.axes[middle])
        lines = Lines(state, sensor.times, sensor.positions, sensor.axes) if middle else None
        found[image.digest] = Candidate(state, path, None, sensor.camera, str(path), lines)
    return found, []


def _by_colmap(
    workspace: Workspace,
    images: Sequence[OpenedImage],
    choice: StateChoice,
    line_times: LineTimes,
) -> _Found:
    """Return states and cameras of a COLMAP model."""
    del workspace, line_times
    assert choice.path is not None
    file = choice.path / "cameras.bin"
    cameras = read_colmap_cameras(file, first_pixel=choice.first_pixel) if file.is_file() else {}
    unit = "km" if choice.unit == "km" else "m"
    candidates = {
        state.name: Candidate(state, choice.path, None, cameras.get(number), str(file))
        for state, number in read_colmap(choice.path, unit=unit)  # type: ignore[arg-type]
    }
    return _matched(images, candidates, choice.path)


_FINDERS: dict[
    StateKind, Callable[[Workspace, Sequence[OpenedImage], StateChoice, LineTimes], _Found]
] = {
    StateKind.POSES: _by_poses,
    StateKind.SPICE: _by_kernels,
    StateKind.LABEL: _by_labels,
    StateKind.ISD: _by_isd,
    StateKind.COLMAP: _by_colmap,
}
