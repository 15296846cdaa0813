"""Cameras from the labels of ISIS cubes, into which ``spiceinit`` copies an instrument's keywords.

The cube may be a crop, reduced or enlarged: its group AlphaCube states which part of the original
image it is. Which part of a detector the original image is, each mission's software knows: cameras
are read of those for which it is stated here.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.instrument import CameraAt, Instrument
from spcola.camera.models import turned_metric_camera
from spcola.errors import FormatError
from spcola.formats.images.isis_label import group, read_gdal_label
from spcola.spice.instruments.kernel import (
    LROC_NAC,
    camera_of,
    detector_of,
    temperature_law,
)
from spcola.spice.instruments.keywords import Keywords, Value

_APOLLO_METRIC = (-915240, -916240, -917240)
# Samples and lines of the original images.
_FRAMES = {-64081: (2592, 1944), -64082: (2592, 1944)}
_NAC_SAMPLES = 5064
_CELSIUS = ("celsius", "degc", "c")
_INSTRUMENT = re.compile(r"INS(-?[0-9]{1,10})_(.+)")


@dataclass(frozen=True)
class _Part:
    """The part of the original image that a cube is, from its AlphaCube.

    Parameters
    ----------
    original : (2,) of int
        Samples and lines of the original image.
    start : (2,) ndarray
        Sample and line in the original of the cube's upper left corner (0.5, 0.5).
    scale : (2,) ndarray
        Pixels of the cube in one of the original.
    size : (2,) of int
        Samples and lines of the cube.
    """

    original: tuple[int, int]
    start: FloatArray
    scale: FloatArray
    size: tuple[int, int]

    def camera(self, camera: Camera) -> Camera:
        """Return the camera of the cube from that of the original image."""
        return replace(
            camera,
            center=(camera.center - self.start) * self.scale + 0.5,
            k_matrix=camera.k_matrix * self.scale[:, None],
            width=self.size[0],
            height=self.size[1],
        )


def read_cube_camera(path: str | Path) -> CameraAt | None:
    """Return the camera of an ISIS cube of a frame camera or a line scanner; None if not known.

    Known are Apollo's metric cameras, OSIRIS-REx's NavCams (focal length at the temperature of the
    camera head in the label, as ISIS has it) and LROC's NACs. The only line of a line scanner's
    camera is line 1. A camera that looks along −Z of its frame (Apollo) is turned about x, as its
    states are.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If the label cannot be read, or contradicts what is known of the instrument.
    """
    label = read_gdal_label(path, "ISIS3")
    keywords = _keywords(label, str(path))
    if keywords is None:
        return None
    number, part = keywords.numbers[0], _part(label, str(path))
    if number in _APOLLO_METRIC:
        return CameraAt(part.camera(_apollo(keywords, part)), ())
    stated = group(label, "IsisCube", "Instrument")
    if number in LROC_NAC:
        return CameraAt(_nac(keywords, part, stated), ())
    if number not in _FRAMES:
        return None
    if part.original != _FRAMES[number]:
        raise FormatError(
            f"is of an image of {part.original} pixels, its detector has {_FRAMES[number]}",
            path,
            "give --camera",
        )
    nominal = camera_of(keywords, part.original, 1)
    navcam = Instrument("NAVCAM", nominal, temperature_law(keywords))
    shot = navcam.at(temperature_c=_celsius(stated.get("CameraHeadTemperature")))
    return replace(shot, camera=part.camera(shot.camera))


def _celsius(value: Any) -> float | None:
    """Return a temperature of a label, °C; None if it is not stated so."""
    if not isinstance(value, Mapping) or str(value.get("unit")).lower() not in _CELSIUS:
        return None
    number = value.get("value")
    return float(number) if isinstance(number, (int, float)) else None


def read_cube_lines(path: str | Path) -> FloatArray:
    """Return the times (L,) of the middle of each line of a cube of LROC's NAC, ephemeris time, s.

    As ISIS has it: lines follow each other from the clock's count before the exposure on, after a
    stated number of lines that are not in the image, at the stated duration with its error.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If the cube is of another instrument, or a keyword is missing.
    """
    label = read_gdal_label(path, "ISIS3")
    keywords = _keywords(label, str(path))
    if keywords is None or keywords.numbers[0] not in LROC_NAC:
        raise FormatError(
            "is of a line scanner whose lines' times are not read from labels",
            path,
            "known is LROC's NAC; others come in with --states isd",
        )
    part = _part(label, str(path))
    duration = group(label, "IsisCube", "Instrument", "LineExposureDuration")
    if duration.get("unit") != "ms" or not isinstance(duration.get("value"), (int, float)):
        raise FormatError("does not state LineExposureDuration in ms", path)
    line_s = 1e-3 * float(duration["value"])
    line_s = line_s * (1.0 + keywords.number("MULTIPLI_LINE_ERROR"))
    line_s += keywords.number("ADDITIVE_LINE_ERROR")
    start = _clock_time(label, str(path)) + keywords.number("CONSTANT_TIME_OFFSET")
    start += keywords.number("ADDITIONAL_PREROLL") * line_s
    lines = part.start[1] + (np.arange(1, part.size[1] + 1) - 0.5) / part.scale[1]
    times: FloatArray = start + (lines - 0.5) * line_s
    return times


def _keywords(label: Mapping[str, Any], where: str) -> Keywords | None:
    """Return the instrument's keywords; None if there are none, or of several instruments."""
    pool: dict[tuple[int, str], Value] = {}
    for name, value in group(label, "NaifKeywords").items():
        match = _INSTRUMENT.fullmatch(name)
        if match:
            items = value if isinstance(value, list) else [value]
            numbers = [float(one) if isinstance(one, (int, float)) else str(one) for one in items]
            pool[int(match[1]), match[2]] = tuple(numbers)
    found = [number for number, name in pool if name == "FOCAL_LENGTH"]
    return Keywords(pool, (found[0],), "", where) if len(found) == 1 else None


def _part(label: Mapping[str, Any], where: str) -> _Part:
    """Return which part of the original image a cube is: all of it, without an AlphaCube."""
    size = group(label, "IsisCube", "Core", "Dimensions")
    alpha = group(label, "IsisCube", "AlphaCube")
    try:
        now = int(size["Samples"]), int(size["Lines"])
        if not alpha:
            return _Part(now, np.array([0.5, 0.5]), np.ones(2), now)
        original = int(alpha["AlphaSamples"]), int(alpha["AlphaLines"])
        start, end = (
            np.array([float(alpha[f"Alpha{which}{axis}"]) for axis in ("Sample", "Line")])
            for which in ("Starting", "Ending")
        )
        beta = int(alpha["BetaSamples"]), int(alpha["BetaLines"])
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"has a group AlphaCube that cannot be read ({error})", where) from error
    if beta != now or not np.all(end > start):
        raise FormatError(f"its AlphaCube is of {beta} pixels, the cube has {now}", where)
    return _Part(original, start, np.array(now) / (end - start), now)


def _apollo(keywords: Keywords, part: _Part) -> Camera:
    """Return Apollo's metric camera on the whole film, the axis in its middle."""
    linear, _ = detector_of(keywords, keywords.number("PIXEL_PITCH"), 1, np.zeros(2))
    linear = np.column_stack([linear[:, 0], -linear[:, 1], np.zeros(2)])
    values = turned_metric_camera(
        keywords.vector("PP", 2), keywords.vector("OD_K", 3), keywords.vector("DECENTER", 3)
    )
    middle = np.array(part.original) / 2.0
    focal = keywords.number("FOCAL_LENGTH")
    return Camera(focal, middle, linear, *part.original, "hasselblad", values)


def _nac(keywords: Keywords, part: _Part, instrument: Mapping[str, Any]) -> Camera:
    """Return LROC's NAC: samples of the cube, and the only line of the detector.

    A sample of the original image is the sum of ``SpatialSumming`` detector pixels;
    ``SampleFirstPixel`` counts the ones before the first, from 0 (ISIS). Lines are not summed.
    """
    summed, first = (_count(instrument, name) for name in ("SpatialSumming", "SampleFirstPixel"))
    if summed < 1 or first < 0 or first + summed * part.original[0] > _NAC_SAMPLES:
        raise FormatError(
            f"has SpatialSumming {summed}, SampleFirstPixel {first} and {part.original[0]} "
            f"samples, its detector has {_NAC_SAMPLES} pixels",
            keywords.where,
            "give --camera",
        )
    # Kernels number lines of the image by time: line 0 is on the axis.
    camera = camera_of(keywords, (_NAC_SAMPLES, 1), 1)
    scale = part.scale[0] / summed
    start = first + 0.5 + summed * (part.start[0] - 0.5)
    return replace(
        camera,
        center=np.array([(camera.center[0] - start) * scale + 0.5, camera.center[1] + 1.0]),
        k_matrix=camera.k_matrix * [[scale], [1.0]],
        width=part.size[0],
    )


def _count(instrument: Mapping[str, Any], name: str) -> int:
    """Return a whole number of the group Instrument; −1 if there is none."""
    value = instrument.get(name)
    return value if isinstance(value, int) else -1


def _clock_time(label: Mapping[str, Any], where: str) -> float:
    """Return the time of PrerollTime's clock count that ``spiceinit`` computed, s.

    It is a double's bytes in hexadecimal, least significant first.
    """
    counts = [
        value
        for name, values in group(label, "NaifKeywords").items()
        if name.startswith("CLOCK_ET_") and isinstance(values, Mapping)
        for value in values.values()
    ]
    if len(counts) != 1 or not re.fullmatch(r"[0-9a-fA-F]{16}", str(counts[0])):
        raise FormatError(
            "does not state the time of the clock's count (CLOCK_ET_…)", where, "run spiceinit"
        )
    (time,) = struct.unpack("<d", bytes.fromhex(str(counts[0])))
    return float(time)
