"""States from tables of positions and rotations over time, as in ISIS cubes and ISD files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray, check_axes, check_finite, frozen
from spcola.camera.linescan import interpolate_axes, interpolate_positions
from spcola.errors import InvalidValueError
from spcola.navigation.states.image_state import ImageState, StateSource
from spcola.navigation.time import utc_from_et
from spcola.navigation.trajectory import straight_lines

# A single row holds for this time before and after it; several end with their first and last.
_ALONE_S, _ENDS_S = 0.5, 1e-6
_UNIT = 1e-6


@dataclass(frozen=True, eq=False)
class RotationTable:
    """Rotations from J2000 to a frame.

    Parameters
    ----------
    time : (N,) array_like
        Ephemeris time, s, strictly increasing.
    quaternion : (N, 4) array_like
        Scalar first, as SPICE's ``q2m``: its matrix takes J2000 to a time-dependent frame.
    constant : (3, 3) array_like
        Matrix from that frame to the one wanted.
    name : str
        For messages.

    Raises
    ------
    InvalidValueError
        If the times do not increase, a quaternion is not of unit length, or the constant matrix is
        no rotation.
    """

    time: FloatArray
    quaternion: FloatArray
    constant: FloatArray = field(default_factory=lambda: np.eye(3))
    name: str = "rotation"

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", _times(self.time, self.name))
        count = len(self.time)
        quaternion = frozen(self.quaternion, (count, 4), f"{self.name}.quaternion")
        object.__setattr__(self, "quaternion", quaternion)
        object.__setattr__(self, "constant", frozen(self.constant, (3, 3), f"{self.name}.constant"))
        check_axes(self.constant, f"{self.name}.constant")
        length = np.linalg.norm(quaternion, axis=1)
        if not np.all(np.abs(length - 1.0) < _UNIT):
            raise InvalidValueError("is not of unit length", f"{self.name}.quaternion")

    def at(self, times: ArrayLike, *, method: Literal["slerp", "cubic"] = "slerp") -> FloatArray:
        """Return matrices (M, 3, 3) from J2000 to the frame at ephemeris times (M,), s.

        Between two rows the rotation has a fixed axis and a constant rate ("slerp"), or a smooth
        rate ("cubic"); a single row holds for all times near it.

        Parameters
        ----------
        times : (M,) array_like
        method : {"slerp", "cubic"}

        Raises
        ------
        InvalidValueError
            If a time lies outside the table.
        """
        wanted = _within(self.time, times, self.name)
        # SciPy's matrix of a quaternion turns vectors as SPICE's does.
        rows = Rotation.from_quat(self.quaternion[:, [1, 2, 3, 0]]).as_matrix()
        turned: FloatArray = self.constant @ interpolate_axes(
            self.time, rows, wanted, method=method
        )
        return turned


@dataclass(frozen=True, eq=False)
class PositionTable:
    """Positions relative to a body's origin, along the axes of J2000.

    Parameters
    ----------
    time : (N,) array_like
        Ephemeris time, s, strictly increasing.
    position : (N, 3) array_like
        Metres.
    velocity : (N, 3) array_like, optional
        Metres per second; NaN if unknown.
    name : str
        For messages.

    Raises
    ------
    InvalidValueError
        If the times do not increase or a position is not finite.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    name: str = "position"

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", _times(self.time, self.name))
        shape = (len(self.time), 3)
        velocity = np.full(shape, np.nan) if self.velocity is None else self.velocity
        object.__setattr__(self, "position", frozen(self.position, shape, f"{self.name}.position"))
        object.__setattr__(self, "velocity", frozen(velocity, shape, f"{self.name}.velocity"))
        check_finite(self.position, f"{self.name}.position")

    def at(self, times: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions (M, 3), m, and velocities (M, 3), m/s, at ephemeris times (M,), s.

        Cubic Hermite interpolation with velocities; without, they are unknown (NaN). A single row
        holds for all times near it.

        Raises
        ------
        InvalidValueError
            If a time lies outside the table.
        """
        wanted = _within(self.time, times, self.name)
        known = bool(np.isfinite(self.velocity).all())
        positions = interpolate_positions(
            self.time, self.position, wanted, velocities=self.velocity if known else None
        )
        return positions, straight_lines(self.time, self.velocity, wanted)


@dataclass(frozen=True, eq=False)
class StateTables:
    """All that gives the states of one image: of a frame camera at one time, of a scanner at many.

    Parameters
    ----------
    pointing : RotationTable
        J2000 to the camera.
    position : PositionTable
        Spacecraft relative to the body.
    body : RotationTable
        J2000 to the body-fixed frame.
    sun : PositionTable, optional
        Sun relative to the body.
    source : StateSource
    """

    pointing: RotationTable
    position: PositionTable
    body: RotationTable
    sun: PositionTable | None
    source: StateSource

    @property
    def span(self) -> tuple[float, float]:
        """First and last ephemeris time, s, at which pointing and position are known."""
        tables = (self.pointing.time, self.position.time)
        return max(float(t[0]) for t in tables), min(float(t[-1]) for t in tables)

    def along(
        self, times: ArrayLike, *, method: Literal["slerp", "cubic"] = "slerp"
    ) -> tuple[FloatArray, FloatArray]:
        """Return positions (N, 3), m, and axes of the camera's frame (N, 3, 3), body-fixed.

        Parameters
        ----------
        times : (N,) array_like
            Ephemeris time, s.
        method : {"slerp", "cubic"}
            Between two attitudes of the camera, as of :meth:`RotationTable.at`.

        Raises
        ------
        InvalidValueError
            If a time lies outside the tables.
        """
        body = self.body.at(times)
        pointing = self.pointing.at(times, method=method)
        positions = np.einsum("nij,nj->ni", body, self.position.at(times)[0])
        return positions, pointing @ np.swapaxes(body, -1, -2)

    @property
    def backward(self) -> bool:
        """Whether the camera looks along −Z of its frame, as Apollo's metric cameras do.

        It is determined by the body's origin, in front of any camera that images the body.
        """
        middle = sum(self.span) / 2.0
        toward = -self.position.at([middle])[0][0]
        return bool(self.pointing.at([middle])[0][2] @ toward < 0.0)

    def state(self, name: str, time: float | None = None) -> ImageState:
        """Return the state of an image.

        SPC's Cz is the boresight: the axes of a camera that looks `backward` are turned by 180°
        about Cx, so that y of its focal plane has the opposite sign.

        Parameters
        ----------
        name : str
            Of the image.
        time : float, optional
            Ephemeris time, s; the middle of the tables if not given.

        Raises
        ------
        InvalidValueError
            If the time lies outside the tables.
        """
        moment = sum(self.span) / 2.0 if time is None else time
        axes = self.pointing.at([moment])[0]
        if self.backward:
            axes = np.diag([1.0, -1.0, -1.0]) @ axes
        turn = self.body.at([moment])[0]
        position, velocity = (rows[0] for rows in self.position.at([moment]))
        sun = np.full(3, np.nan)
        if self.sun is not None:
            toward = turn @ self.sun.at([moment])[0][0]
            sun = toward / np.linalg.norm(toward)
        return ImageState(
            name,
            float(moment),
            -turn @ position,
            axes @ turn.T,
            self.source,
            sun=sun,
            velocity=turn @ velocity,
        )


def _times(time: FloatArray, name: str) -> FloatArray:
    """Return times (N,) after checking that there are some, and that they increase."""
    times = frozen(time, (None,), f"{name}.time")
    check_finite(times, f"{name}.time")
    if not len(times):
        raise InvalidValueError("has no row", name)
    if np.any(np.diff(times) <= 0):
        place = int(np.argmax(np.diff(times) <= 0)) + 2
        raise InvalidValueError(f"row {place} does not follow the one before in time", name)
    return times


def _within(known: FloatArray, times: ArrayLike, name: str) -> FloatArray:
    """Return times (M,), those just outside a table moved to its ends."""
    wanted = np.asarray(times, dtype=np.float64)
    outside = np.maximum(known[0] - wanted, wanted - known[-1])
    if not np.all(outside <= (_ALONE_S if len(known) == 1 else _ENDS_S)):
        worst = int(np.argmax(outside))
        raise InvalidValueError(
            f"does not cover {utc_from_et(float(wanted[worst]))}, {outside[worst]:.3f} s outside",
            f"{name}, {utc_from_et(float(known[0]))} to {utc_from_et(float(known[-1]))}",
            "take a time inside, or another source of states",
        )
    return np.clip(wanted, known[0], known[-1])
