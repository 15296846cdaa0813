"""Image summaries, .SUM: camera, spacecraft state, Sun, and the landmarks seen in one image."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import FloatArray, check_axes
from spcola.camera import Camera, SpcImage
from spcola.errors import FormatError
from spcola.formats.solution.exact_camera import (
    DISTORTION_DIGITS,
    K_DECIMALS,
    exact_camera,
    split_camera_line,
    stored_camera,
    write_exact_camera,
)
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
from spcola.formats.text.source import KM, LARGEST_RANGE_KM, as_format_error, check_name
from spcola.navigation import et_from_utc

_LINE_SCAN_COLUMN = 13
_LARGEST_SIDE = 65536


def read_summary(path: str | Path) -> SpcImage:
    """Read the .SUM file at `path`.

    The sections LANDMARKS and LIMB FITS may be absent; the line ``END FILE`` may not. The older
    ``SIGPXL`` instead of ``DISTORTION`` is ignored: such a camera has no distortion. Where Owen's
    distortion is only a fit to the camera's, the camera is that of the camera file next to it
    (:mod:`spcola.formats.solution.exact_camera`).

    Returns
    -------
    SpcImage
        Without pixels; metres and radians. Negative sigmas mean unknown: NaN.

    Raises
    ------
    FormatError
        If a line is missing or has unexpected content, a direction is no unit vector, the
        spacecraft is further than 1e7 km, the image is of a line-scan camera, or the file with its
        exact camera is missing or damaged.
    """
    cursor = LineCursor(path)
    cursor.lines, camera_file = split_camera_line(cursor.lines)
    name = read_image_name(cursor)
    utc = _read_utc(cursor)
    width, height, thresholds = _read_size(cursor)
    optics = cursor.next_fields(3, "MMFL, CTR")
    scobj = read_scobj(cursor)
    axes = read_axes(cursor)
    sun = cursor.next_unit_vector("SZ")
    k_matrix = cursor.next_fields(6, "K-MATRIX").reshape(2, 3)
    k_line = cursor.number
    distortion = _read_distortion(cursor)
    with as_format_error(f"{path}, lines 3, 4 and {k_line}"):
        camera = Camera(
            float(optics[0]), optics[1:], k_matrix, width, height, distortion=distortion
        )
    camera = exact_camera(cursor.path, camera, camera_file)
    sigmas = (cursor.next_sigma("SIGMA_VSO", "SIG_VSO"), cursor.next_sigma("SIGMA_PTG", "SIG_PTG"))
    seen = read_sections(
        cursor,
        {
            "LANDMARKS": partial(read_point, kind="landmark", extra=False),
            "LIMB FITS": partial(read_point, kind="landmark", extra=True),
        },
    )
    refuse_duplicates(cursor, seen["LANDMARKS"], "LANDMARKS")
    with as_format_error(str(path)):
        return SpcImage(
            name,
            utc,
            camera,
            scobj,
            axes,
            sun,
            thresholds,
            sigmas[0] * KM,
            sigmas[1],
            points_under(seen, "LANDMARKS"),
            points_under(seen, "LIMB FITS"),
        )


def write_summary(path: str | Path, image: SpcImage, *, like: str | Path | None = None) -> None:
    """Write a .SUM file (the pixels go into a .DAT file, :mod:`spcola.formats.images.dat`).

    An unknown sigma is written as −1, which SPC interprets as a weak prior. A camera whose
    distortion is not Owen's is fitted, and written next to it
    (:mod:`spcola.formats.solution.exact_camera`).

    Parameters
    ----------
    path : str or Path
        Written whole or not at all.
    image : SpcImage
        Metres and radians.
    like : str or Path, optional
        A file whose layout is kept for unchanged lines (:mod:`spcola.formats.text.layout`).

    Raises
    ------
    InvalidValueError
        If a name is too long for SPC, the camera's distortion folds over on its detector, or a
        number does not fit its columns.
    WorkspaceError
        If the file cannot be written.
    """
    check_name(image.name, "image", path)
    stored = stored_camera(image.camera)
    text = "".join([*_lines(replace(image, camera=stored.fitted, pixels=None)), stored.line])
    text = in_layout_of(text, like)
    write_exact_camera(Path(path), stored, None if like is None else Path(like))
    atomic.write_text(path, text)


def read_image_name(cursor: LineCursor) -> str:
    """Return the image's name on the next (first) line.

    A FormatError if there is none, it does not fit SPC, or column 14 marks a line-scan image.
    """
    line = cursor.next("the image's name")
    if line[_LINE_SCAN_COLUMN : _LINE_SCAN_COLUMN + 1] == "L":
        raise cursor.error(
            "is of a line-scan camera (L in column 14): only framing cameras are read"
        )
    return read_name(cursor, line.strip(), "image")


def read_scobj(cursor: LineCursor) -> FloatArray:
    """Return V0 (3,), metres, of the next line; a FormatError if it is longer than 1e7 km."""
    scobj = cursor.next_fields(3, "SCOBJ")
    distance = float(np.linalg.norm(scobj))
    if distance > LARGEST_RANGE_KM:
        raise cursor.error(f"the spacecraft is {distance:.6g} km away", "is it in metres?")
    return scobj * KM


def read_axes(cursor: LineCursor) -> FloatArray:
    """Return the camera axes (3, 3), rows Cx, Cy, Cz, of the next three lines.

    A FormatError if they are not orthonormal and right-handed.
    """
    axes = np.array([cursor.next_unit_vector(label) for label in ("CX", "CY", "CZ")])
    with as_format_error(f"{cursor.path}, lines {cursor.number - 2}-{cursor.number}"):
        check_axes(axes, "camera")
    return axes


def _read_utc(cursor: LineCursor) -> str:
    """Return the time on the next line unchanged, after checking it."""
    utc = cursor.next("the time of the exposure").strip()
    try:
        et_from_utc(utc)
    except FormatError as error:
        raise cursor.error(error.what) from error
    return utc


def _read_size(cursor: LineCursor) -> tuple[int, int, tuple[int, int]]:
    """Return NPX, NLN and the two thresholds of the next line."""
    width, height, low, high = cursor.next_integers(4, "NPX, NLN, THRSH")
    if not (1 <= width <= _LARGEST_SIDE and 1 <= height <= _LARGEST_SIDE):
        raise cursor.error(f"NPX, NLN: an image cannot have {width} × {height} pixels")
    if low > high:
        raise cursor.error(f"THRSH: the lower threshold {low} is above the upper one {high}")
    return width, height, (low, high)


def _read_distortion(cursor: LineCursor) -> FloatArray:
    """Return the distortion coefficients (4,); zeros where an older file has SIGPXL."""
    line = cursor.next("the line DISTORTION")
    if line.endswith("SIGPXL"):
        cursor.fields(line, (1, 2, 3, 4), ["SIGPXL"])
        return np.zeros(4)
    return cursor.fields(line, (4,), ["DISTORTION"])


def _lines(image: SpcImage) -> list[str]:
    """Return the lines of the file of `image`."""
    camera = image.camera
    low, high = image.thresholds
    k_matrix = "".join(format_fixed(float(k), 10, K_DECIMALS) for k in camera.k_matrix.ravel())
    return [
        f"{image.name}\n",
        f"{image.utc}\n",
        labelled(f"{camera.width:6d}{camera.height:6d}{low:6d}{high:6d}", "NPX, NLN, THRSH"),
        vector_line(np.array([camera.focal_length_mm, *camera.center]), "MMFL, CTR"),
        vector_line(image.scobj / KM, "SCOBJ"),
        *(vector_line(image.axes[row], label) for row, label in enumerate(("CX", "CY", "CZ"))),
        vector_line(image.sun, "SZ"),
        labelled(k_matrix, "K-MATRIX"),
        labelled(
            "".join(format_d(float(d), 15, DISTORTION_DIGITS) for d in camera.distortion),
            "DISTORTION",
        ),
        vector_line(image.scobj_sigma / KM, "SIGMA_VSO"),
        vector_line(image.pointing_sigma, "SIGMA_PTG"),
        "LANDMARKS\n",
        *(point_line(point, "landmark", 6) for point in image.landmarks),
        "LIMB FITS\n",
        *(point_line(point, "landmark", 6) for point in image.limbs),
        f"{END}\n",
    ]
