"""Geometry in PDS3 and PDS4 labels: what is stated, in SI units.

PDS3's keywords are those of its data dictionary: SC_TARGET_POSITION_VECTOR, SC_SUN_POSITION_VECTOR
and TARGET_SUN_POSITION_VECTOR (J2000, km), RIGHT_ASCENSION and DECLINATION of the boresight,
CELESTIAL_NORTH_CLOCK_ANGLE or TWIST_ANGLE, QUATERNION, and SUB_SPACECRAFT_… and SUB_SOLAR_…. PDS4's
are those of the Geometry discipline: ``Vector_Cartesian_Position_…``,
``Object_Orientation_RA_Dec``, ``Quaternion_Plus_To_From``, ``Surface_Geometry_Specific``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.images.image_label import first_text, quantity, text_of
from spcola.formats.text import KM

_LENGTHS: dict[str | None, float] = {
    **dict.fromkeys((None, "km", "kilometer", "kilometers", "kilometre"), KM),
    **dict.fromkeys(("m", "meter", "meters", "metre"), 1.0),
}
_ANGLES: dict[str | None, float] = {
    **dict.fromkeys((None, "deg", "degree", "degrees"), 1.0),
    **dict.fromkeys(("rad", "radian", "radians"), float(np.degrees(1.0))),
}
_INERTIAL = ("J2000", "EMEJ2000", "EME2000", "ICRF", "GCRF")


@dataclass(frozen=True)
class Keywords:
    """Names of what a state needs, for messages."""

    target: str
    boresight: str
    clock: str


PDS3 = Keywords(
    "SC_TARGET_POSITION_VECTOR", "RIGHT_ASCENSION and DECLINATION", "CELESTIAL_NORTH_CLOCK_ANGLE"
)
PDS4 = Keywords(
    "geom:Vector_Cartesian_Position_Spacecraft_To_Target",
    "geom:Object_Orientation_RA_Dec",
    "geom:celestial_north_clock_angle",
)


@dataclass(frozen=True, eq=False)
class LabelGeometry:
    """Geometry that a label states; None where it does not.

    Parameters
    ----------
    keywords : Keywords
    target : (3,) ndarray, optional
        From the spacecraft to the body's centre, metres.
    sun : (3,) ndarray, optional
        To the Sun, metres.
    sun_from_craft : bool
        Whether that is from the spacecraft, not from the body's centre.
    body_fixed : bool
        Whether the label names a frame of the body for these vectors; otherwise they are along
        J2000.
    boresight_deg : (2,) of float, optional
        Right ascension and declination.
    twist_deg : float, optional
        Rotation about the boresight from the east to the right of the display, towards the north.
    quaternions : tuple of (4,) ndarray
        In any of the conventions.
    sub_spacecraft_deg, sub_solar_deg : (2,) of float, optional
        Latitude and longitude.
    east : bool, optional
        Whether longitudes run to the east and latitudes are planetocentric.
    distance : float, optional
        From the spacecraft to the body's centre, metres.
    phase_deg : float, optional
    """

    keywords: Keywords
    target: FloatArray | None = None
    sun: FloatArray | None = None
    sun_from_craft: bool = False
    body_fixed: bool = False
    boresight_deg: tuple[float, float] | None = None
    twist_deg: float | None = None
    quaternions: tuple[FloatArray, ...] = ()
    sub_spacecraft_deg: tuple[float, float] | None = None
    sub_solar_deg: tuple[float, float] | None = None
    east: bool | None = None
    distance: float | None = None
    phase_deg: float | None = None


def pds3_geometry(label: Mapping[str, Any], where: str) -> LabelGeometry:
    """Return the geometry in the keywords of a PDS3 label, also those in its groups.

    Raises
    ------
    FormatError
        If a value has an unusable unit, or angles contradict each other.
    """
    flat = {**dict(_in_groups(label)), **label}
    read = _Reader(flat, where)
    sun, from_craft = (read.vector(f"{name}_SUN_POSITION_VECTOR") for name in ("TARGET", "SC"))
    quaternion = read.numbers("QUATERNION", {None: 1.0})
    return LabelGeometry(
        PDS3,
        read.vector("SC_TARGET_POSITION_VECTOR"),
        from_craft if sun is None else sun,
        sun is None,
        boresight_deg=read.angles("RIGHT_ASCENSION", "DECLINATION"),
        twist_deg=_pds3_twist(read),
        quaternions=() if quaternion is None or len(quaternion) != 4 else (quaternion,),
        sub_spacecraft_deg=read.angles("SUB_SPACECRAFT_LATITUDE", "SUB_SPACECRAFT_LONGITUDE"),
        sub_solar_deg=read.angles("SUB_SOLAR_LATITUDE", "SUB_SOLAR_LONGITUDE"),
        east=_east(flat),
        distance=read.number("TARGET_CENTER_DISTANCE", _LENGTHS),
        phase_deg=read.number("PHASE_ANGLE", _ANGLES),
    )


def pds4_geometry(label: Mapping[str, Any], where: str) -> LabelGeometry:
    """Return what the Geometry discipline states in a PDS4 label.

    Raises
    ------
    FormatError
        If a value has an unusable unit, or a frame is neither J2000 nor the body's.
    """
    found = dict(_in_groups(label)).get("Geometry")
    geometry = dict(_in_groups(found)) if isinstance(found, Mapping) else {}
    read = _Reader(geometry, where)
    target, craft, sun = (
        read.position(f"Vector_Cartesian_Position_{name}")
        for name in ("Spacecraft_To_Target", "Sun_To_Spacecraft", "Sun_To_Target")
    )
    from_sun = craft if sun is None else sun
    clock = read.number("celestial_north_clock_angle", _ANGLES)
    frame = _frame_of(geometry.get("Object_Orientation_RA_Dec"), where)
    return LabelGeometry(
        PDS4,
        target,
        None if from_sun is None else -from_sun,
        sun is None,
        body_fixed=read.body_fixed("Vector_Cartesian_Position_Spacecraft_To_Target"),
        boresight_deg=None if frame else read.angles("right_ascension_angle", "declination_angle"),
        twist_deg=None if clock is None else 180.0 - clock,
        quaternions=tuple(_pds4_quaternions(found, where)),
        sub_spacecraft_deg=read.angles("subspacecraft_latitude", "subspacecraft_longitude"),
        sub_solar_deg=read.angles("subsolar_latitude", "subsolar_longitude"),
        distance=read.number("spacecraft_target_center_distance", _LENGTHS),
        phase_deg=read.number("phase_angle", _ANGLES),
    )


def _pds4_quaternions(geometry: Any, where: str) -> Iterator[FloatArray]:
    """Yield the quaternions of an element, at any depth."""
    for name, value in geometry.items() if isinstance(geometry, Mapping) else ():
        for item in value if isinstance(value, list) else [value]:
            if name == "Quaternion_Plus_To_From" and isinstance(item, Mapping):
                read = _Reader(item, where)
                parts = [read.number(f"q{k}", {None: 1.0}) for k in ("cos", "sin1", "sin2", "sin3")]
                if None not in parts:
                    yield np.array(parts, dtype=np.float64)
            else:
                yield from _pds4_quaternions(item, where)


@dataclass(frozen=True)
class _Reader:
    """Values of keywords by their names; None where there is none, N/A and the like."""

    keywords: Mapping[str, Any]
    where: str

    def numbers(self, name: str, units: Mapping[str | None, float]) -> FloatArray | None:
        """Return numbers of a keyword."""
        value = self.keywords.get(name)
        items = value if isinstance(value, list) else [value]
        found = [quantity(item) for item in items]
        if any(one is None for one in found):
            return None
        for _, unit in (one for one in found if one is not None):
            if unit not in units:
                raise FormatError(f"{name} has the unit {unit!r}", self.where, "give --poses")
        return np.array([one[0] * units[one[1]] for one in found if one is not None])

    def number(self, name: str, units: Mapping[str | None, float]) -> float | None:
        """Return one number."""
        found = self.numbers(name, units)
        return None if found is None or len(found) != 1 else float(found[0])

    def vector(self, name: str) -> FloatArray | None:
        """Return three lengths, metres."""
        found = self.numbers(name, _LENGTHS)
        return None if found is None or len(found) != 3 or not found.any() else found

    def angles(self, first: str, second: str) -> tuple[float, float] | None:
        """Return two angles, degrees; the first has the range of a latitude or a longitude."""
        one, two = (self.number(name, _ANGLES) for name in (first, second))
        return None if one is None or two is None else (one, two)

    def position(self, name: str) -> FloatArray | None:
        """Return a vector of PDS4, metres."""
        entry = self.keywords.get(name)
        if not isinstance(entry, Mapping):
            return None
        inner = _Reader(entry, f"{self.where}: {name}")
        parts = [inner.number(f"{axis}_position", _LENGTHS) for axis in "xyz"]
        return None if None in parts else np.array(parts, dtype=np.float64)

    def body_fixed(self, name: str) -> bool:
        """Return whether a vector of PDS4 is stated in a frame of the body."""
        return _frame_of(self.keywords.get(name), self.where) is not None


def _frame_of(entry: Any, where: str) -> str | None:
    """Return the name of a body's frame that an element of PDS4 states; None for J2000.

    Raises
    ------
    FormatError
        If it is another frame.
    """
    inside = dict(_in_groups(entry)) if isinstance(entry, Mapping) else {}
    name = text_of(inside.get("frame_spice_name")) or text_of(inside.get("name")) or "J2000"
    plain = name.upper().replace(" ", "")
    if plain in _INERTIAL:
        return None
    if plain.startswith("IAU_") or plain.endswith("_FIXED"):
        return name
    raise FormatError(f"states geometry in the frame {name!r}", where, "give --poses")


def _pds3_twist(read: _Reader) -> float | None:
    """Return the twist of PDS3's angles; its dictionary relates the two of them."""
    clock, twist = (
        read.number(name, _ANGLES) for name in ("CELESTIAL_NORTH_CLOCK_ANGLE", "TWIST_ANGLE")
    )
    kind = text_of(read.keywords.get("TWIST_ANGLE_TYPE"))
    if twist is not None:
        host = first_text(read.keywords, "INSTRUMENT_HOST_NAME", "SPACECRAFT_NAME") or ""
        galileo = kind == "GALILEO" or (kind is None and "GALILEO" in host.upper())
        twist -= 90.0 if galileo else 0.0
    if clock is None:
        return twist
    if twist is not None and abs((twist + clock) % 360.0 - 180.0) > 1.0:
        raise FormatError(
            "TWIST_ANGLE and CELESTIAL_NORTH_CLOCK_ANGLE contradict each other",
            read.where,
            "give --poses",
        )
    return 180.0 - clock


def _east(keywords: Mapping[str, Any]) -> bool | None:
    """Return whether longitudes run to the east; None if that is open, or latitudes are graphic."""
    system = (text_of(keywords.get("COORDINATE_SYSTEM_NAME")) or "").upper()
    direction = (text_of(keywords.get("POSITIVE_LONGITUDE_DIRECTION")) or "").upper()
    if system == "PLANETOCENTRIC" and direction in ("", "EAST", "WEST"):
        return direction != "WEST"
    return None


def _in_groups(label: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield keywords and groups at any depth, those of a group before the group itself."""
    for name, value in label.items():
        items: Sequence[Any] = value if isinstance(value, list) else [value]
        groups = [item for item in items if isinstance(item, Mapping) and "unit" not in item]
        for group in groups:
            yield from _in_groups(group)
        yield name, (groups[0] if groups else value)
