"""States of images whose lines were exposed one after the other: line scans, rolling shutters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.stages.images.opened import OpenedImage
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.instrument import Instrument
from spcola.camera.linescan import LineScan
from spcola.errors import FormatError, InvalidValueError
from spcola.navigation.states import ImageState
from spcola.spice.instruments import read_cube_lines

__all__ = ["LineTimes", "Lines", "lines_from", "lines_from_states", "scan_of_lines"]

# Lines of a label and of a camera file differ by no more, unless one has another unit.
_SAME_LINE = 0.1


@dataclass(frozen=True, eq=False)
class Lines:
    """The states of the lines of an image.

    Parameters
    ----------
    middle : ImageState
        That of the middle line.
    times : (L,) ndarray
        Ephemeris times of the lines' mid-exposures, s.
    positions : (L, 3) ndarray
        Of the camera, body-fixed, metres.
    axes : (L, 3, 3) ndarray
        Rows Cx, Cy, Cz, body-fixed.
    """

    middle: ImageState
    times: FloatArray
    positions: FloatArray
    axes: FloatArray


@dataclass(frozen=True, eq=False)
class LineTimes:
    """When the lines of images were exposed, by their labels and the camera.

    Parameters
    ----------
    instrument : Instrument, optional
    """

    instrument: Instrument | None

    def are_needed(self, image: OpenedImage) -> bool:
        """Return whether the lines of an image have states of their own."""
        return image.scanner or self._step is not None

    @property
    def _step(self) -> float | None:
        return None if self.instrument is None else self.instrument.line_time_s

    def of(self, image: OpenedImage) -> FloatArray:
        """Return the times (L,) of the lines' mid-exposures, ephemeris time, s.

        Those of LROC's NAC are in the cube. With the camera's time from line to line, the time in
        the label is that of the middle of the image.

        Raises
        ------
        FormatError
            If label and camera do not state them, or contradict each other.
        """
        if image.scanner and image.label["format"] == "isis":
            return read_cube_lines(image.path)
        if self._step is None:
            raise FormatError(
                "is of a line scanner, and the times of its lines are not known",
                image.path,
                "state line_time_s in the camera file, or name lines in the table of --poses",
            )
        if image.time is None:
            raise FormatError(
                "the label does not state when it was exposed",
                image.path,
                "name lines in the table of --poses",
            )
        stated = image.label["line_exposure_s"]
        if stated is not None and abs(abs(self._step) / stated - 1.0) > _SAME_LINE:
            raise FormatError(
                f"its label has {stated:g} s a line, the camera file {abs(self._step):g} s",
                image.path,
                "are both in seconds?",
            )
        count = image.size[1]
        times: FloatArray = image.time + self._step * (np.arange(count) - (count - 1) / 2.0)
        return times


def lines_from(
    states: Sequence[ImageState], times: FloatArray, positions: FloatArray, axes: FloatArray
) -> Lines:
    """Return the states of lines that were interpolated between some.

    Sun and sigmas of the middle are those of the state next to it.
    """
    half = len(times) // 2
    near = min(states, key=lambda state: abs(state.time - times[half]))
    middle = replace(near, time=float(times[half]), scobj=-positions[half], axes=axes[half])
    return Lines(middle, times, positions, axes)


def lines_from_states(states: Sequence[ImageState]) -> Lines:
    """Return the states of lines from one state for each."""
    return Lines(
        states[len(states) // 2],
        np.array([state.time for state in states]),
        np.array([state.position for state in states]),
        np.array([state.axes for state in states]),
    )


def scan_of_lines(image: OpenedImage, camera: Camera, lines: Lines) -> LineScan:
    """Return the line scan of an image, or the image of a rolling shutter.

    Raises
    ------
    InvalidValueError
        If the camera has another number of lines than one, or, of a rolling shutter, than the
        image.
    """
    if image.scanner and camera.height != 1:
        raise InvalidValueError(
            f"is of a line scanner, its camera has {camera.height} lines",
            image.path,
            "state size = [samples, 1] in the camera file",
        )
    if camera.height not in (1, image.size[1]):
        raise InvalidValueError(
            f"has {image.size[1]} lines, its camera {camera.height}",
            image.path,
            "give the camera of this image, or of one line for a line scanner",
        )
    shutter = "rolling" if camera.height > 1 else "line"
    return LineScan(camera, lines.times, lines.positions, lines.axes, shutter)  # type: ignore[arg-type]
