"""The states of one image in a table of poses: one, or several of an image exposed line by line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.linescan import interpolate_axes, interpolate_positions
from spcola.errors import FormatError
from spcola.formats.text.source import as_format_error
from spcola.navigation.states import ImageState


@dataclass(frozen=True, eq=False)
class PoseRows:
    """The states of one image in a table.

    Parameters
    ----------
    states : tuple of ImageState
    lines : (N,) ndarray, optional
        Line of the image at which each holds, from 1.
    places : tuple of str
        Where each is, for messages.
    """

    states: tuple[ImageState, ...]
    lines: FloatArray | None
    places: tuple[str, ...]

    def only(self) -> ImageState:
        """Return the one state.

        Raises
        ------
        FormatError
            If there are several.
        """
        if len(self.states) > 1:
            raise FormatError(
                f"{self.states[0].name} appears twice",
                self.places[1],
                "remove one line (several are read for line scans and rolling shutters alone)",
            )
        return self.states[0]

    def along(
        self, count: int, times: Callable[[], FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return times (L,), s, positions (L, 3), m, and axes (L, 3, 3) of an image's lines.

        Positions lie on a cubic spline of the body-fixed ones, attitudes turn at a constant rate
        from row to row.

        Parameters
        ----------
        count : int
            Number L of lines.
        times : callable
            Returns the times (L,) of the lines; called where the table names no lines.

        Raises
        ------
        FormatError
            If the rows do not cover all lines, a time is missing, or times do not follow the lines.
        """
        at = np.array([state.time for state in self.states])
        if not np.isfinite(at).all():
            raise FormatError("has several rows and no times", self.places[0], "add a column et")
        wanted = times() if self.lines is None else self._times_of_all(self.lines, at, count)
        order = np.argsort(at)
        with as_format_error(self.places[0]):
            positions = np.array([state.position for state in self.states])[order]
            axes = np.array([state.axes for state in self.states])[order]
            return (
                wanted,
                interpolate_positions(at[order], positions, wanted),
                interpolate_axes(at[order], axes, wanted),
            )

    def _times_of_all(self, lines: FloatArray, times: FloatArray, count: int) -> FloatArray:
        """Return the times (L,) of all lines from those of some, (N,)."""
        order = np.argsort(lines)
        lines, steps = lines[order], np.diff(times[order])
        if lines[0] > 1.0 or lines[-1] < count:
            raise FormatError(
                f"has states of lines {lines[0]:g} to {lines[-1]:g}, the image has {count} lines",
                self.places[0],
                "add rows for its first and last line",
            )
        if not (np.diff(lines) > 0.0).all() or not ((steps > 0.0).all() or (steps < 0.0).all()):
            raise FormatError(
                "names a line twice, or times that do not follow the lines", self.places[0]
            )
        found: FloatArray = np.interp(np.arange(1.0, count + 1.0), lines, times[order])
        return found
