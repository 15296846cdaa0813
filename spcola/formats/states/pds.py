"""The state of an image from the geometry in its PDS label."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.images import ImageFile
from spcola.formats.states.pds_geometry import LabelGeometry, pds3_geometry, pds4_geometry
from spcola.formats.states.poses import axes_of_pointing
from spcola.formats.text.source import as_format_error
from spcola.navigation import Spin
from spcola.navigation.states import ImageState, StateSource

_SPEED_OF_LIGHT = 299_792_458.0
# A quaternion's third axis is the boresight to this angle, radians; two statements of one direction
# that differ by less are rounded, by more than the other contradict each other, degrees.
_SAME_AXIS, _ROUNDED_DEG, _CONTRADICTS_DEG = np.radians(0.5), 1.0, 15.0
_READERS = {"pds3": pds3_geometry, "pds4": pds4_geometry}


@dataclass(frozen=True, eq=False)
class LabelState:
    """State that a label gives, and how it was read, one sentence each.

    Parameters
    ----------
    state : ImageState
        Its Sun is NaN where the label does not state it.
    notes : tuple of str
    """

    state: ImageState
    notes: tuple[str, ...]


def read_pds_state(image: ImageFile, name: str, time: float, spin: Spin | None) -> LabelState:
    """Return the state of an image by the geometry in its PDS3 or PDS4 label.

    The attitude is that of the boresight's right ascension and declination and the clock angle of
    celestial north (or the twist): Cx is to the right of the image as its label displays it, Cy
    down. Without such an angle it is that of the quaternion, in the one of the four conventions
    (scalar first or last, from J2000 or to it) in which its third axis is the boresight.

    Vectors are along J2000, or in the body's frame where the label says so, or where they agree
    with the sub-spacecraft point only so. The rotation of the body is that of the light's start.

    Parameters
    ----------
    image : ImageFile
    name : str
        Of the state.
    time : float
        Middle of the exposure, ephemeris time, s.
    spin : Spin, optional
        Rotation of the body.

    Raises
    ------
    FormatError
        If the label has no geometry that is enough, with the keyword that is missing; or parts of
        it contradict each other.
    """
    where = str(image.label_path or image.path)
    geometry = _READERS[str(image.format)](image.label.keywords, where)
    _check_enough(geometry, where, spin)
    assert spin is not None
    distance = geometry.distance
    if geometry.target is not None:
        distance = float(np.linalg.norm(geometry.target))
        _check_distance(distance, geometry, where)
    assert distance is not None
    turn = spin.axes([time - distance / _SPEED_OF_LIGHT])[0]
    frames = _Frames(geometry, turn, where)
    position, notes = frames.position(distance)
    sun = frames.sun(position)
    _check_phase(position, sun, geometry, where)
    axes, read_as = _attitude(geometry, where)
    with as_format_error(where):
        state = ImageState(name, time, -position, axes @ turn.T, StateSource.PDS, sun=sun)
    return LabelState(state, (*notes, read_as))


def _check_enough(geometry: LabelGeometry, where: str, spin: Spin | None) -> None:
    """Refuse a label that does not determine a state, and name what is missing."""
    names = geometry.keywords
    missing = None
    if geometry.target is None and not _sub_point_is_enough(geometry):
        missing = names.target
        if geometry.sub_spacecraft_deg and geometry.distance and geometry.east is None:
            missing += " (or COORDINATE_SYSTEM_NAME = PLANETOCENTRIC for the sub-spacecraft point)"
    elif geometry.boresight_deg is None:
        missing = names.boresight
    elif geometry.twist_deg is None and not geometry.quaternions:
        missing = names.clock
    if missing is not None:
        raise FormatError(
            f"its label gives no state: {missing} is missing", where, "take --poses or --states "
            "spice",
        )  # fmt: skip
    if spin is None:
        raise FormatError(
            "is along J2000, and the rotation of the body is not stated", where, "give --pck"
        )


def _sub_point_is_enough(geometry: LabelGeometry) -> bool:
    return None not in (geometry.sub_spacecraft_deg, geometry.distance, geometry.east)


def _check_distance(found: float, geometry: LabelGeometry, where: str) -> None:
    """Refuse a vector whose length is not the distance that the label states."""
    stated = geometry.distance
    if stated and abs(found / stated - 1.0) > 0.01:
        raise FormatError(
            f"{geometry.keywords.target} is {found / 1e3:.6g} km long, the distance is stated as "
            f"{stated / 1e3:.6g} km",
            where,
            "are both in kilometres? give --poses",
        )


@dataclass(frozen=True, eq=False)
class _Frames:
    """Vectors of a label in the body's frame: each one's frame is that of its stated point."""

    geometry: LabelGeometry
    turn: FloatArray
    where: str

    def position(self, distance: float) -> tuple[FloatArray, list[str]]:
        """Return the spacecraft's place, body-fixed, and how it was read."""
        point = self.geometry.sub_spacecraft_deg
        if self.geometry.target is None:
            assert point is not None
            toward = _direction(point, east=bool(self.geometry.east))
            return distance * toward, ["position from the sub-spacecraft point"]
        found, notes = self._fixed(-self.geometry.target, point, self.geometry.keywords.target)
        return found, notes

    def sun(self, position: FloatArray) -> FloatArray:
        """Return the unit vector to the Sun, body-fixed; NaN if the label does not give it."""
        point = self.geometry.sub_solar_deg
        if self.geometry.sun is None:
            if point is not None and self.geometry.east is not None:
                return _direction(point, east=self.geometry.east)
            return np.full(3, np.nan)
        found, _ = self._fixed(self.geometry.sun, point, "the vector to the Sun")
        found = found + position if self.geometry.sun_from_craft else found
        unit: FloatArray = found / np.linalg.norm(found)
        return unit

    def _fixed(
        self, vector: FloatArray, point: tuple[float, float] | None, name: str
    ) -> tuple[FloatArray, list[str]]:
        """Return a vector in the body's frame, and how it was read.

        Along J2000, as PDS has it, unless the label names the body's frame, or only so the vector
        points to the place on the body that the label states.
        """
        readings = {"along J2000": self.turn @ vector, "body-fixed": vector}
        chosen = "body-fixed" if self.geometry.body_fixed else "along J2000"
        if point is None:
            return readings[chosen], [f"{name} read as {chosen}"]
        ways = (True, False) if self.geometry.east is None else (self.geometry.east,)
        away = {
            how: min(_angle_deg(found, _direction(point, east=east)) for east in ways)
            for how, found in readings.items()
        }
        if away["body-fixed"] < min(away[chosen], _ROUNDED_DEG):
            chosen = "body-fixed"
        if away[chosen] > _CONTRADICTS_DEG:
            raise FormatError(
                f"{name} lies {away[chosen]:.0f}° from the point under it that the label states",
                self.where,
                "is the rotation that of the label's time and body? give --pck or --poses",
            )
        apart = f", {away[chosen]:.1f}° from the stated point" * (away[chosen] > _ROUNDED_DEG)
        return readings[chosen], [f"{name} read as {chosen}{apart}"]


def _check_phase(
    position: FloatArray, sun: FloatArray, geometry: LabelGeometry, where: str
) -> None:
    """Refuse a Sun that does not give the stated phase angle."""
    if geometry.phase_deg is None or not np.isfinite(sun).all():
        return
    # The label's is that of a point on the ground: nearby it differs much. A sign stands out.
    phase, stated = _angle_deg(position, sun), geometry.phase_deg
    if abs(phase - stated) > max(45.0, 3.0 * abs(180.0 - phase - stated)):
        raise FormatError(
            f"its vectors to body and Sun give a phase angle of {phase:.1f}°, it states "
            f"{stated:.1f}°",
            where,
            "one of them has the wrong sign: give --poses",
        )


def _attitude(geometry: LabelGeometry, where: str) -> tuple[FloatArray, str]:
    """Return the axes (3, 3) along J2000, and how they were read."""
    assert geometry.boresight_deg is not None
    if geometry.twist_deg is not None:
        return axes_of_pointing(*geometry.boresight_deg, geometry.twist_deg), (
            "attitude from right ascension, declination and clock angle: Cx to the right of the "
            "display, Cy down"
        )
    boresight = axes_of_pointing(*geometry.boresight_deg, 0.0)[2]
    found = [
        (axes, how)
        for axes, how in _readings(geometry)
        if float(np.arccos(np.clip(axes[2] @ boresight, -1.0, 1.0))) < _SAME_AXIS
    ]
    if len(found) != 1:
        raise FormatError(
            f"{geometry.keywords.clock} is missing, and the third axis of the quaternion is the "
            f"boresight in {len(found) or 'none'} of its conventions",
            where,
            "take --poses or --states spice",
        )
    axes, how = found[0]
    return axes, f"attitude from the quaternion, {how}: its third axis is the boresight"


def _readings(geometry: LabelGeometry) -> Iterator[tuple[FloatArray, str]]:
    """Yield the rotations that quaternions mean in the conventions in use."""
    for quaternion in geometry.quaternions:
        if abs(float(np.linalg.norm(quaternion)) - 1.0) > 1e-3:
            continue
        for order, parts in (("first", [1, 2, 3, 0]), ("last", [0, 1, 2, 3])):
            matrix = Rotation.from_quat(quaternion[parts]).as_matrix()
            yield matrix, f"scalar {order}, from J2000"
            yield matrix.T, f"scalar {order}, to J2000"


def _direction(point_deg: tuple[float, float], *, east: bool) -> FloatArray:
    """Return the unit vector of latitude and longitude, degrees."""
    lat, lon = np.radians(point_deg)
    lon = lon if east else -lon
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def _angle_deg(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between vectors, degrees."""
    cosine = one @ other / (np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
