"""What the label of an image states, in one form for all formats."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import isfinite
from typing import Any

from spcola.camera.detector import Orientation
from spcola.errors import FormatError
from spcola.navigation import et_from_utc

# Units as labels write them, lower-case: seconds.
_SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), 1e-6),
}
_KELVIN = {"k", "kelvin", "degk", "deg k"}
_CELSIUS = {"c", "celsius", "degc", "deg c", "degrees_celsius"}
_ZERO_CELSIUS = 273.15
_WITHOUT_VALUE = {"", "N/A", "NA", "UNK", "UNKNOWN", "NULL", "NONE"}
_WITH_UNIT = re.compile(r"\s*([-+.\dEe]+)\s*<\s*([^>]+?)\s*>\s*")

# Labels round times to milliseconds; a larger difference is a contradiction.
_ROUNDING_S = 0.002


class TimeSource(StrEnum):
    """Where the middle of the exposure comes from."""

    STATED = "stated"
    START_AND_EXPOSURE = "start_and_exposure"
    START_AND_STOP = "start_and_stop"


@dataclass(frozen=True)
class MidExposure:
    """Middle of an exposure.

    Parameters
    ----------
    et : float
        TDB seconds past J2000.
    source : TimeSource
    """

    et: float
    source: TimeSource


@dataclass(frozen=True, eq=False)
class ImageLabel:
    """What a label states; ``None`` or empty where it does not.

    Parameters
    ----------
    name : str, optional
        Product or file name.
    target, instrument, filter : str, optional
    start_utc, stop_utc, mid_utc : str, optional
        UTC of the exposure, as written.
    exposure_s : float, optional
        Exposure time, seconds.
    line_exposure_s : float, optional
        Exposure time of one line of a line-scan camera, seconds.
    clock_start, clock_stop : str, optional
        Spacecraft clock counts.
    temperatures_k : mapping of str to float
        Temperatures in kelvin by keyword or device.
    orientation : Orientation, optional
        Display directions of lines and samples.
    keywords : mapping
        The whole label, nested as in the file; a value with a unit is
        ``{"value": …, "unit": …}``.
    notes : tuple of str
        What in the label is doubtful: contradictions, numbers without a unit.
    """

    name: str | None = None
    target: str | None = None
    instrument: str | None = None
    filter: str | None = None
    start_utc: str | None = None
    stop_utc: str | None = None
    mid_utc: str | None = None
    exposure_s: float | None = None
    line_exposure_s: float | None = None
    clock_start: str | None = None
    clock_stop: str | None = None
    temperatures_k: Mapping[str, float] = field(default_factory=dict)
    orientation: Orientation | None = None
    keywords: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def mid_exposure(self) -> MidExposure | None:
        """Return the middle of the exposure, or None if the label does not determine it.

        It is the stated one; or start plus half the exposure time; or the middle of start and
        stop.

        Raises
        ------
        FormatError
            If a time cannot be read, the stop lies before the start, or a stated middle lies
            outside them.
        """
        start, stop, mid = (_et(text) for text in (self.start_utc, self.stop_utc, self.mid_utc))
        if start is not None and stop is not None and stop < start:
            raise FormatError(
                f"ends ({self.stop_utc}) before it starts ({self.start_utc})", "label"
            )
        if mid is not None:
            if (start is not None and mid < start - _ROUNDING_S) or (
                stop is not None and mid > stop + _ROUNDING_S
            ):
                raise FormatError(
                    f"gives a middle of the exposure ({self.mid_utc}) outside its start and stop "
                    f"({self.start_utc}, {self.stop_utc})",
                    "label",
                )
            return MidExposure(mid, TimeSource.STATED)
        if start is None:
            return None
        if self.exposure_s is not None:
            return MidExposure(start + 0.5 * self.exposure_s, TimeSource.START_AND_EXPOSURE)
        if stop is not None:
            return MidExposure(0.5 * (start + stop), TimeSource.START_AND_STOP)
        return None


def text_of(value: Any) -> str | None:
    """Return the text of a label's value, or None for ``N/A`` and the like; lists are joined."""
    if isinstance(value, Mapping):
        value = value.get("value")
    if isinstance(value, list | tuple):
        return " ".join(part for part in map(text_of, value) if part) or None
    if value is None or isinstance(value, bool):
        return None
    text = str(value).strip().strip('"').strip()
    return None if text.upper() in _WITHOUT_VALUE else text


def first_text(keywords: Mapping[str, Any], *names: str) -> str | None:
    """Return the text of the first keyword that has one."""
    return next((text for text in (text_of(keywords.get(name)) for name in names) if text), None)


def quantity(value: Any) -> tuple[float, str | None] | None:
    """Return number and unit (lower-case; None without) of a value, or None if it is no number."""
    unit = None
    if isinstance(value, Mapping):
        value, unit = value.get("value"), value.get("unit")
    if isinstance(value, str) and (matched := _WITH_UNIT.fullmatch(value)):
        value, unit = matched.groups()
    if value is None or isinstance(value, bool | list):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    if not isfinite(number):
        return None
    return (number, None if unit is None else str(unit).strip().lower())


def seconds(value: Any, *, without_unit: float | None) -> float | None:
    """Return a duration in seconds, or None if it is no positive one of a known unit.

    Parameters
    ----------
    value : Any
        Of the label.
    without_unit : float, optional
        Seconds that a number without a unit counts, where the format's standard gives one.
    """
    found = quantity(value)
    if found is None or not 0 < found[0] < 1e9:
        return None
    scale = without_unit if found[1] is None else _SECONDS.get(found[1])
    return None if scale is None else found[0] * scale


def kelvin(value: Any) -> float | None:
    """Return a temperature in kelvin, or None if it has no unit of temperature."""
    found = quantity(value)
    if found is None or found[1] is None:
        return None
    if found[1] in _KELVIN:
        return found[0]
    return found[0] + _ZERO_CELSIUS if found[1] in _CELSIUS else None


def temperatures(keywords: Mapping[str, Any]) -> dict[str, float]:
    """Return the temperatures with units among `keywords`, in kelvin; lists are numbered."""
    return {name: value for name, value in _temperatures(keywords) if "temperature" in name.lower()}


def exposure_notes(label: ImageLabel) -> tuple[str, ...]:
    """Return a note where start, stop and exposure time contradict each other."""
    apart, exposure = elapsed(label.start_utc, label.stop_utc), label.exposure_s
    if apart is None or exposure is None or fits_times(exposure, apart):
        return ()
    return (f"start and stop are {apart:.6g} s apart, the exposure time is {exposure:.6g} s",)


def elapsed(start: str | None, stop: str | None) -> float | None:
    """Return seconds from start to stop; None if one is not known, or both are the same."""
    try:
        first, last = _et(start), _et(stop)
    except FormatError:
        return None
    return None if first is None or last is None or first == last else last - first


def fits_times(exposure: float, apart: float) -> bool:
    """Return whether an exposure time is that from start to stop, to 1 % or rounding, seconds."""
    return abs(apart - exposure) <= max(_ROUNDING_S, 0.01 * exposure)


def _temperatures(keywords: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    for name, value in keywords.items():
        items = value if isinstance(value, list) else [value]
        for number, item in enumerate(items, start=1):
            if (found := kelvin(item)) is not None:
                yield (f"{name}_{number}" if len(items) > 1 else name), found


def _et(utc: str | None) -> float | None:
    """Return ephemeris time of a label's UTC."""
    if utc is None:
        return None
    return et_from_utc(utc[:-1] if utc.endswith(("Z", "z")) else utc)
