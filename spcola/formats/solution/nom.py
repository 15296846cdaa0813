"""Nominal states, .NOM: name, velocity, SCOBJ, SIGMA_VSO, CX, CY, CZ, SIGMA_PTG, and the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import FloatArray
from spcola.formats.solution.sum import read_axes, read_image_name, read_scobj
from spcola.formats.text.fortran import vector_line
from spcola.formats.text.layout import in_layout_of
from spcola.formats.text.lines import LineCursor
from spcola.formats.text.source import KM, check_name
from spcola.navigation import NominalState

_FASTEST_KM_S = 1000.0
_LABELS = ("SCOBJ", "SIGMA_VSO", "CX", "CY", "CZ", "SIGMA_PTG")


def read_nominal(path: str | Path) -> NominalState:
    """Read the .NOM file at `path`; lines after SIGMA_PTG are kept unchanged.

    Raises
    ------
    FormatError
        If a line is missing or has unexpected content, the velocity exceeds 1000 km/s, or
        the spacecraft is further than 1e7 km.
    """
    cursor = LineCursor(path)
    name = read_image_name(cursor)
    velocity, frame = _read_velocity(cursor)
    scobj = read_scobj(cursor)
    scobj_sigma = cursor.next_sigma("SIGMA_VSO", "SIG_VSO") * KM
    axes = read_axes(cursor)
    pointing_sigma = cursor.next_sigma("SIGMA_PTG", "SIG_PTG")
    rest = tuple(cursor.lines[cursor.number :])
    return NominalState(name, velocity, scobj, axes, scobj_sigma, pointing_sigma, frame, rest)


def write_nominal(path: str | Path, state: NominalState, *, like: str | Path | None = None) -> None:
    """Write a .NOM file; an unknown sigma is written as −1.

    Parameters
    ----------
    path : str or Path
        Written whole or not at all.
    state : NominalState
        Metres, metres per second and radians.
    like : str or Path, optional
        A file whose layout is kept for unchanged lines (:mod:`spcola.formats.text.layout`).

    Raises
    ------
    InvalidValueError
        If the name is too long for SPC.
    WorkspaceError
        If the file cannot be written.
    """
    check_name(state.name, "image", path)
    lines = [
        f"{state.name}\n",
        vector_line(state.velocity / KM, state.sigma_frame).rstrip() + "\n",
        vector_line(state.scobj / KM, "SCOBJ"),
        vector_line(state.scobj_sigma / KM, "SIGMA_VSO"),
        *(vector_line(state.axes[row], label) for row, label in enumerate(("CX", "CY", "CZ"))),
        vector_line(state.pointing_sigma, "SIGMA_PTG"),
        *(f"{line}\n" for line in state.rest),
    ]
    atomic.write_text(path, in_layout_of("".join(lines), like))


def _read_velocity(cursor: LineCursor) -> tuple[FloatArray, str]:
    """Return the velocity (3,), m/s, and the word after it, of the next line."""
    words = cursor.next("the velocity").split()
    label = " ".join(words[3:])
    if len(words) < 3 or label in _LABELS:
        raise cursor.error("expected the velocity: three numbers and the frame of SIGMA_VSO")
    velocity = cursor.numbers(words[:3], "velocity")
    speed = float(np.linalg.norm(velocity))
    if speed > _FASTEST_KM_S:
        raise cursor.error(f"a spacecraft does not move at {speed:.6g} km/s", "is it in m/s?")
    return velocity * KM, label
