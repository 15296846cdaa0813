"""The program's own camera file: a TOML table for each instrument.

    [NAC]
    focal_length_mm = 135.68
    center = [512.5, 512.5]     # pixel and line of the axis; (1, 1) is the first pixel's centre
    k_matrix = [[71.4, 0.0, 0.0], [0.0, -71.4, 0.0]]  # pixels per mm, of x, y and x·y
    size = [1024, 1024]                 # pixels, lines
    distortion_model = "owen"
    distortion = [2e-5, 3e-8, 0.0, 0.0]
    temperature = {reference_c = 20.0, per_kelvin = 1.1e-5}
    pupil_m = [0.1, 0.0, 1.2]           # from the centre of mass, spacecraft's frame
    frame_transfer = {line_s = 9e-7, clearing_s = 0.0, memory = "first-line"}
    line_time_s = 3.6e-4                # from one line's exposure to the next one's

    [NAC.focus]                         # one row of each list for a position of the mechanism
    motor = [4231, 17371]
    inverse_range_per_m = [0.005, 0.0]
    focal_length_mm = [615.0, 628.9]
    distortion = [[…], […]]             # or none

Only focal length, centre, K-matrix and size are needed. `frame_transfer` is of a detector without a
shutter: times for one line of the transfer into the memory and of the one that clears the frame
before (if any), and the edge at which the memory lies. `line_time_s` is of cameras whose lines are
exposed one after the other: line scanners (size of one line), and rolling shutters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spcola import atomic
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.detector import SmearTimes
from spcola.camera.instrument import FocusTable, Instrument, Pupil, ThermalFocus
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.text.fields import Fields
from spcola.formats.text.source import as_format_error

_NAMES = {
    "focal_length_mm", "center", "k_matrix", "size", "distortion_model", "distortion",
    "temperature", "pupil_m", "focus", "frame_transfer", "line_time_s",
}  # fmt: skip


_TRANSFER = {"line_s", "clearing_s", "memory"}


def read_cameras(path: str | Path) -> dict[str, Instrument]:
    """Read a camera file: instruments by their names.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If the file is no TOML, has no camera, or a field is missing, unknown or unusable.
    """
    return cameras_in(Fields.read_toml(path))


def cameras_in(fields: Fields) -> dict[str, Instrument]:
    """Return the instruments in the `fields` of a camera file, by their names.

    Raises
    ------
    FormatError
        As :func:`read_cameras`.
    """
    found = {}
    for name, table in fields.content.items():
        if not isinstance(table, Mapping):
            raise FormatError("is no table of a camera", fields.where(name))
        unknown = sorted(set(table) - _NAMES)
        if unknown:
            raise FormatError(f"is no field of a camera; known are {_listed(_NAMES)}",
                              fields.where(f"{name}.{unknown[0]}"))  # fmt: skip
        with as_format_error(fields.where(name)):
            found[name] = _instrument(Fields(fields.path, table), name)
    if not found:
        raise FormatError("has no camera", fields.path)
    return found


def write_cameras(
    path: str | Path, instruments: Iterable[Instrument], *, remarks: Iterable[str] = ()
) -> None:
    """Write a camera file, atomically; numbers keep all their digits.

    Parameters
    ----------
    path : str or Path
    instruments : iterable of Instrument
    remarks : iterable of str
        Comments at its top: where the numbers come from.

    Raises
    ------
    WorkspaceError
        If it cannot be written.
    """
    atomic.write_text(path, camera_text(instruments, remarks=remarks))


def camera_text(instruments: Iterable[Instrument], *, remarks: Iterable[str] = ()) -> str:
    """Return the text of a camera file of `instruments`, as :func:`write_cameras` writes it.

    `remarks` are comments at its top.
    """
    lines = [f"# {' '.join(remark.split())}" for remark in remarks]
    for one in instruments:
        lines += ["", *_lines(one)]
    return "\n".join(lines) + "\n"


def _instrument(fields: Fields, name: str) -> Instrument:
    """Return one camera of its table."""
    size = [int(side) for side in fields.vector("size", 2)]
    if size != fields.get("size"):
        raise InvalidValueError(f"is {fields.get('size')}, no whole numbers of pixels", "size")
    model = fields.text("distortion_model", "owen")
    distortion = np.zeros(4) if fields.get("distortion") is None else fields.vector("distortion")
    camera = Camera(
        fields.number("focal_length_mm"),
        fields.vector("center", 2),
        fields.table("k_matrix", 3),
        size[0],
        size[1],
        model,  # type: ignore[arg-type]  # the camera checks it
        distortion,
    )
    temperature = pupil = focus = None
    if fields.get("temperature") is not None:
        temperature = ThermalFocus(
            fields.number("temperature.reference_c"), fields.number("temperature.per_kelvin")
        )
    if fields.get("pupil_m") is not None:
        pupil = Pupil(name, fields.vector("pupil_m", 3))
    if fields.get("focus") is not None:
        shape = fields.get("focus.distortion")
        focus = FocusTable(
            fields.vector("focus.motor"),
            fields.vector("focus.inverse_range_per_m"),
            fields.vector("focus.focal_length_mm"),
            np.zeros((0, 0))
            if shape is None
            else fields.table("focus.distortion", len(distortion)),
        )
    line_time = None if fields.get("line_time_s") is None else fields.number("line_time_s")
    return Instrument(name, camera, temperature, focus, pupil, _smear(fields), line_time)


def _smear(fields: Fields) -> SmearTimes | None:
    """Return the times of the frame transfer, if they are stated."""
    table = fields.get("frame_transfer")
    if table is None:
        return None
    unknown = sorted(set(table) - _TRANSFER) if isinstance(table, Mapping) else [str(table)]
    if unknown:
        raise InvalidValueError(
            f"has {unknown[0]}; known are {_listed(_TRANSFER)}", "frame_transfer"
        )
    stated = "clearing_s" in table
    clearing = fields.number("frame_transfer.clearing_s") if stated else 0.0
    side = fields.text("frame_transfer.memory", "first-line").replace("-", " ")
    line_s = fields.number("frame_transfer.line_s")
    return SmearTimes(line_s, clearing, side)  # type: ignore[arg-type]  # the value checks it


def _lines(one: Instrument) -> list[str]:
    """Return the lines of one instrument."""
    camera = one.camera
    lines = [
        f"[{_key(one.name)}]",
        f"focal_length_mm = {camera.focal_length_mm!r}",
        f"center = {_array(camera.center)}",
        f"k_matrix = {_array(camera.k_matrix)}",
        f"size = [{camera.width}, {camera.height}]",
        f'distortion_model = "{camera.distortion_model}"',
        f"distortion = {_array(camera.distortion)}",
    ]
    if one.temperature is not None:
        law = one.temperature
        lines.append(
            f"temperature = {{reference_c = {law.reference_c!r}, per_kelvin = {law.per_kelvin!r}}}"
        )
    if one.pupil is not None:
        lines.append(f"pupil_m = {_array(one.pupil.offset)}")
    if one.smear is not None:
        line_s, clearing_s = one.smear.line_transfer_s, one.smear.clearing_s
        side = one.smear.memory_side.replace(" ", "-")
        times = f"line_s = {line_s!r}, clearing_s = {clearing_s!r}"
        lines.append(f'frame_transfer = {{{times}, memory = "{side}"}}')
    if one.line_time_s is not None:
        lines.append(f"line_time_s = {one.line_time_s!r}")
    if one.focus is not None:
        lines += [
            "",
            f"[{_key(one.name)}.focus]",
            f"motor = {_array(one.focus.motor)}",
            f"inverse_range_per_m = {_array(one.focus.inverse_range)}",
            f"focal_length_mm = {_array(one.focus.focal_length_mm)}",
        ]
        if one.focus.distortion.size:
            lines.append(f"distortion = {_array(one.focus.distortion)}")
    return lines


def _array(values: FloatArray) -> str:
    return repr(np.asarray(values).tolist())


def _key(name: str) -> str:
    """Return a name as a quoted key of TOML.

    Raises
    ------
    FormatError
        If it has a character that TOML does not take there.
    """
    if not name.isprintable() or any(mark in name for mark in '"\\'):
        raise FormatError(f"{name!r} cannot name a camera in a file", do="use letters and digits")
    return f'"{name}"'


def _listed(names: Any) -> str:
    return ", ".join(sorted(names))
