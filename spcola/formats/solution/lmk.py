"""Landmarks, .LMK: a maplet's frame, its uncertainty, the images with it, its neighbours."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.camera import ImagePoint
from spcola.control import Landmark, MapOverlap
from spcola.errors import InvalidValueError
from spcola.formats.solution.sections import (
    END,
    point_line,
    points_under,
    read_name,
    read_point,
    read_sections,
    refuse_duplicates,
)
from spcola.formats.text.fortran import format_d, format_fixed, labelled, vector_line
from spcola.formats.text.layout import in_layout_of
from spcola.formats.text.lines import LineCursor
from spcola.formats.text.source import KM, as_format_error, check_grid_km, check_name
from spcola.grids import MapletGrid

_STATUS_COLUMN = 9
_OVERLAPS = "MAP OVERLAPS"


def read_landmark(path: str | Path) -> Landmark:
    """Read the .LMK file at `path`.

    Every section (PICTURES, MAP OVERLAPS, LIMB FITS) may be absent; ``END FILE`` may not.

    Returns
    -------
    Landmark
        Metres. Negative sigmas mean unknown: NaN.

    Raises
    ------
    FormatError
        If a line is missing or has unexpected content, or the frame is absurd (see
        :func:`spcola.formats.text.source.check_grid_km`).
    """
    cursor = LineCursor(path)
    name, status = _read_first_line(cursor)
    half_size, gsd_km = _read_size(cursor)
    horizon = cursor.next_integers(4, "HORIZON")
    prior_km, rms = cursor.next_fields(2, "SIGKM, RMSLMK")
    center_km = cursor.next_fields(3, "VLM")
    with as_format_error(f"{path}, lines 2 and {cursor.number}"):
        check_grid_km(center_km, gsd_km, half_size)
    axes = np.array([cursor.next_unit_vector(label) for label in ("UX", "UY", "UZ")])
    with as_format_error(f"{path}, lines {cursor.number - 2}-{cursor.number}"):
        grid = MapletGrid(center_km * KM, axes, gsd_km * KM, half_size)
    sigma = cursor.next_sigma("SIGMA_LMK", "SIMGA_LMK")
    pictures, overlaps, limbs = _read_lists(cursor)
    return Landmark(
        name,
        grid,
        sigma * KM,
        _known(prior_km) * KM,
        _known(rms),
        status,
        (horizon[0], horizon[1], horizon[2], horizon[3]),
        pictures,
        overlaps,
        limbs,
    )


def write_landmark(path: str | Path, landmark: Landmark, *, like: str | Path | None = None) -> None:
    """Write a .LMK file; an unknown sigma is written as −1.

    Empty lists of overlaps and limb observations get no heading, as in the published files.

    Parameters
    ----------
    path : str or Path
        Written whole or not at all.
    landmark : Landmark
        Metres.
    like : str or Path, optional
        A file whose layout is kept for unchanged lines (:mod:`spcola.formats.text.layout`).

    Raises
    ------
    InvalidValueError
        If a name is too long for SPC, or a number does not fit its columns.
    WorkspaceError
        If the file cannot be written.
    """
    atomic.write_text(path, in_layout_of("".join(_lines(landmark)), like))


def _known(value: float) -> float:
    """Return `value`, or NaN for a negative number, which means unknown."""
    return float("nan") if value < 0 else float(value)


def _read_first_line(cursor: LineCursor) -> tuple[str, str]:
    """Return name and status of the first line."""
    words = cursor.next("the landmark's name").split()
    if len(words) not in (1, 2) or (len(words) == 2 and len(words[1]) != 1):
        raise cursor.error("expected a name and a one-letter status (T or F)")
    return read_name(cursor, words[0], "landmark"), words[1] if len(words) == 2 else ""


def _read_size(cursor: LineCursor) -> tuple[int, float]:
    """Return q and the GSD (km) of the next line."""
    size, gsd_km = cursor.next_fields(2, "SIZE, SCALE(KM)")
    if size != int(size) or not 1 <= size <= 65535:
        raise cursor.error(f"SIZE: the half-size must be a whole number 1 … 65535, not {size:g}")
    if gsd_km <= 0:
        raise cursor.error(f"SCALE: the GSD must be positive, not {gsd_km:g} km")
    return int(size), float(gsd_km)


def _read_lists(
    cursor: LineCursor,
) -> tuple[tuple[ImagePoint, ...], tuple[MapOverlap, ...], tuple[ImagePoint, ...]]:
    """Return pictures, overlaps and limb observations from the rest of the file."""
    found = read_sections(
        cursor,
        {
            "PICTURES": partial(read_point, kind="image", extra=False),
            _OVERLAPS: _read_overlap,
            "LIMB FITS": partial(read_point, kind="image", extra=True),
        },
    )
    overlaps = tuple(entry for entry in found[_OVERLAPS] if isinstance(entry, MapOverlap))
    refuse_duplicates(cursor, found["PICTURES"], "PICTURES")
    refuse_duplicates(cursor, overlaps, _OVERLAPS)
    return points_under(found, "PICTURES"), overlaps, points_under(found, "LIMB FITS")


def _read_overlap(cursor: LineCursor, tokens: list[str]) -> MapOverlap:
    """Return the overlap on the current line: a name and three numbers."""
    if len(tokens) != 4:
        raise cursor.error(f"expected a name and three numbers, found {len(tokens)} words")
    name = read_name(cursor, tokens[0], "landmark")
    x, y, h = cursor.numbers(tokens[1:], name)
    return MapOverlap(name, float(x), float(y), float(h))


def _lines(landmark: Landmark) -> list[str]:
    """Return the lines of the file of `landmark`."""
    check_name(landmark.name, "landmark", landmark.name)
    grid = landmark.grid
    check_grid_km(grid.center / KM, grid.gsd / KM, grid.half_size)
    size = f"{grid.half_size:8d}{format_fixed(grid.gsd / KM, 12, 7)}"
    prior = format_d(landmark.prior_sigma / KM, 20, 10) + format_d(landmark.rms, 20, 10)
    lines = [
        f"{landmark.name:<{_STATUS_COLUMN}}{landmark.status}".rstrip() + "\n",
        labelled(size, "SIZE, SCALE(KM)"),
        labelled("".join(f"{number:10d}" for number in landmark.horizon), "HORIZON"),
        labelled(prior, "SIGKM, RMSLMK"),
        vector_line(grid.center / KM, "VLM"),
        *(vector_line(grid.axes[row], label) for row, label in enumerate(("UX", "UY", "UZ"))),
        vector_line(landmark.sigma / KM, "SIGMA_LMK"),
        "PICTURES\n",
        *(point_line(point, "image", 12) for point in landmark.pictures),
    ]
    if landmark.overlaps:
        lines += [f"{_OVERLAPS}\n", *(_overlap_line(overlap) for overlap in landmark.overlaps)]
    if landmark.limbs:
        lines += ["LIMB FITS\n", *(point_line(point, "image", 12) for point in landmark.limbs)]
    return [*lines, f"{END}\n"]


def _overlap_line(overlap: MapOverlap) -> str:
    """Return the line of an overlap: the name in six columns, three numbers in ten each.

    They have two decimals, as in published files, or more if needed to read them again exactly.
    """
    check_name(overlap.name, "landmark", overlap.name)
    numbers = (overlap.x, overlap.y, overlap.h)
    if not np.all(np.abs(numbers) < 1e6):
        raise InvalidValueError(f"{numbers} do not fit their columns", overlap.name)
    return f"{overlap.name:<6}" + "".join(_overlap_number(float(x)) for x in numbers) + "\n"


def _overlap_number(value: float) -> str:
    """Return a number in ten or more columns that reads as the same double."""
    text = f"{value:.2f}"
    if float(text) != value:
        text = repr(value)
    return text.rjust(10) if len(text) < 10 else f" {text}"
