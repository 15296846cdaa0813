"""States that the labels of images give, and how far they are from what is used."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.stages.images.line_states import Lines, LineTimes
from fusion.stages.images.opened import OpenedImage
from spcola.camera import Camera
from spcola.camera.detector import Direction, Orientation
from spcola.errors import FormatError, SpcolaError
from spcola.formats.images import open_image
from spcola.formats.states import read_isis_states, read_pds_state
from spcola.navigation import Spin
from spcola.navigation.states import ImageState, compare_states
from spcola.spice.instruments import read_cube_camera

_PDS = ("pds3", "pds4")
# Directions along x (right) and y (down) of the display.
_WAYS = {
    Direction.RIGHT: (1.0, 0.0), Direction.LEFT: (-1.0, 0.0),
    Direction.DOWN: (0.0, 1.0), Direction.UP: (0.0, -1.0),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class FromLabel:
    """What a label gives.

    Parameters
    ----------
    state : ImageState
        Of a line scan: that of its middle.
    notes : tuple of str
        How it was read.
    lines : Lines, optional
        Of a line scan or a rolling shutter.
    """

    state: ImageState
    notes: tuple[str, ...] = ()
    lines: Lines | None = None


def label_state(
    image: OpenedImage, spin: Spin | None, line_times: LineTimes | None = None
) -> FromLabel:
    """Return the state in an image's label.

    Parameters
    ----------
    image : OpenedImage
    spin : Spin, optional
        Rotation of the body: PDS labels state vectors along J2000.
    line_times : LineTimes, optional
        Of images whose lines have states of their own; only that of the middle if not given.

    Raises
    ------
    FormatError
        If the label has no tables (ISIS cubes), not enough geometry (PDS3, PDS4), or no time.
    """
    form, name = image.label["format"], image.path.stem
    if form == "isis":
        tables = read_isis_states(image.path)
        if line_times is None or not line_times.are_needed(image) or len(tables.pointing.time) < 2:
            return FromLabel(tables.state(name, image.time))
        times = line_times.of(image)
        middle = tables.state(name, float(times[len(times) // 2]))
        positions, axes = tables.along(times)
        if tables.backward:
            axes = np.diag([1.0, -1.0, -1.0]) @ axes
        return FromLabel(middle, (), Lines(middle, times, positions, axes))
    if form not in _PDS:
        raise FormatError(
            f"its label ({form.upper()}) has no tables of the camera's state",
            image.path,
            "take --poses or --states spice",
        )
    if image.time is None or image.scanner:
        lacks = "when it was exposed" if image.time is None else "one state for each line"
        raise FormatError(f"the label does not state {lacks}", image.path, "take --poses")
    found = read_pds_state(open_image(image.path), name, image.time, spin)
    return FromLabel(found.state, found.notes)


def label_camera(image: OpenedImage) -> tuple[Camera | None, tuple[str, ...]]:
    """Return the camera of an ISIS cube, None if it is not known, and what was assumed."""
    found = read_cube_camera(image.path) if image.label["format"] == "isis" else None
    if found is None:
        return None, ()
    return found.camera, tuple(one.text for one in found.assumed)


def other_state_notes(image: OpenedImage, state: ImageState, camera: Camera) -> tuple[str, ...]:
    """Return how far the state in an ISIS cube's tables is from the one that is used."""
    if image.label["format"] != "isis" or image.scanner:
        return ()
    try:
        other = replace(label_state(image, None).state, name=state.name)
    except SpcolaError:
        return ()
    apart = compare_states(state, other, camera)
    pointing = np.degrees(np.linalg.norm(apart.pointing))
    return (
        f"the tables in its label give another state: {np.linalg.norm(apart.camera_m):.4g} m, "
        f"{pointing:.3g}°, {np.hypot(*apart.pixels):.3g} pixels at the boresight away",
    )


def display_notes(image: OpenedImage, camera: Camera) -> tuple[str, ...]:
    """Return a note where camera and label turn the same pixels to different sides.

    An attitude from a PDS label has Cx to the right of the display and Cy down; the K matrix says
    where samples and lines go along them.
    """
    if image.label["format"] not in _PDS:
        return ()
    shown = image.display or Orientation()
    ways = np.linalg.inv(camera.k_matrix[:, :2]).T
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    stated = np.array([_WAYS[shown.sample], _WAYS[shown.line]])
    if (np.einsum("ij,ij->i", ways, stated) > np.sqrt(0.5)).all():
        return ()
    return (
        f"its label displays samples going {shown.sample} and lines going {shown.line}, the "
        "camera's K matrix has them otherwise as they are stored: --report finds the --orientation",
    )
