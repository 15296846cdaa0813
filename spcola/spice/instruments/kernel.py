"""Cameras from NAIF instrument kernels and the addenda that ISIS reads.

Conventions. ISIS's ``TRANSX``, ``ITRANSS`` … connect the focal plane (x, y of the instrument's
frame, mm) with samples and lines. ``BORESIGHT_SAMPLE`` and ``_LINE`` number the first pixel's
centre (1, 1), as SPC does; ``CCD_CENTER`` and ``FOV_CENTER_PIXEL`` number it (0, 0);
``OPENCV_OD_C`` (1, 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import Camera, DistortionModel
from spcola.camera.instrument import FocusTable, Instrument, ThermalFocus
from spcola.errors import FormatError
from spcola.spice.instruments.keywords import Keywords, instrument_pool

_POLYCAM, _POLYCAM_AT_INFINITY = -64360, -64593
_POLYCAM_STEPS = range(-64500, -64617, -1)
LROC_NAC = (-85600, -85610)
_MM_PER_MICROMETRE = 1e-3
# A kernel that states its focal length in metres, as that of TAGCAMS.
_MM_PER_METRE = 1000.0


def read_instrument_kernels(
    paths: Sequence[str | Path],
    number: int,
    *,
    variant: int | None = None,
    filter: str = "",
    size: tuple[int, int] | None = None,
    first_pixel: int = 1,
) -> Instrument:
    """Read a frame camera from instrument kernels (IK) and addenda, in their order of loading.

    Distortion: the model that ``DISTORTION_MODEL`` names (``OCAMS``, ``OPENCV``), or the one of the
    mission whose keywords are there (PP and DECENTER: Apollo; TO_UNDISTORTED_X: OSIRIS; OD_K with
    three numbers: radial, with one: LROC NAC); none without such keywords. Axes are those of the
    instrument's frame in the kernels. Those that ``spcola kernels`` wrote name any model. PolyCam
    gets its table of focus positions (nominal is
    infinity), and a camera with ``OPENCV_OD_A`` its law of temperature, from 0 °C.

    Parameters
    ----------
    paths : sequence of paths
        Text kernels.
    number : int
        NAIF number of the instrument, such as −64361.
    variant : int, optional
        Number whose keywords come first: a filter of MapCam, a focus position of PolyCam.
    filter : str
        Suffix of keywords by filter, such as ``PAN``.
    size : (2,) of int, optional
        Samples and lines, where the kernels do not state them.
    first_pixel : int
        Number of the first pixel in ``BORESIGHT_SAMPLE`` and ``_LINE``: 1 as in LROC's addendum,
        0 in some.

    Raises
    ------
    FormatError
        If a keyword is missing, has other numbers, or contradicts another.
    KernelError
        If a file cannot be read.
    """
    focusing = number == _POLYCAM and variant is None
    if focusing:
        variant = _POLYCAM_AT_INFINITY
    numbers = (number,) if variant is None else (variant, number)
    where = ", ".join(str(path) for path in paths)
    keywords = Keywords(instrument_pool(paths), numbers, filter.upper(), where)
    camera = camera_of(keywords, size, first_pixel)
    temperature = temperature_law(keywords)
    focus = _polycam_focus(keywords, camera) if focusing else None
    name = Keywords(keywords.pool, numbers[::-1], "", where).text("FOV_FRAME") or f"INS{number}"
    return Instrument(name, camera, temperature, focus)


def temperature_law(keywords: Keywords) -> ThermalFocus | None:
    """Return how the focal length of OpenCV's model varies with temperature, if keywords state it.

    ISIS multiplies ``OPENCV_OD_F`` by ``1 + OPENCV_OD_A T``, T in °C.
    """
    if keywords.text("DISTORTION_MODEL") != "OPENCV" or not keywords.number("OPENCV_OD_A"):
        return None
    return ThermalFocus(0.0, keywords.number("OPENCV_OD_A"))


def camera_of(keywords: Keywords, size: tuple[int, int] | None, first_pixel: int) -> Camera:
    """Return the interior orientation that keywords of an instrument state.

    Raises
    ------
    FormatError
        As :func:`read_instrument_kernels`.
    """
    pitch = _pixel_mm(keywords)
    k_linear, origin = detector_of(keywords, pitch, first_pixel)
    focal = keywords.number("FOCAL_LENGTH")
    if keywords.text("DISTORTION_MODEL") == "OPENCV":
        focal = _focal_mm(keywords, focal, pitch)
        k_linear, origin, model, values = _opencv(keywords, k_linear, focal)
    else:
        model, values = _distortion(keywords, k_linear, origin)
    if size is None:
        size = keywords.pixels("PIXEL_SAMPLES"), keywords.pixels("PIXEL_LINES")
    # Kernels that SPCOLA wrote state the whole matrix.
    stated = keywords.get("K_MATRIX") is not None
    mixed = keywords.vector("K_MATRIX", 6).reshape(2, 3)[:, 2] if stated else np.zeros(2)
    k_matrix = np.column_stack([k_linear, mixed])
    return Camera(focal, origin, k_matrix, *size, model, values)


def _pixel_mm(keywords: Keywords) -> float:
    """Return the size of a pixel, mm: ``PIXEL_PITCH`` is in mm, ``PIXEL_SIZE`` in micrometres."""
    if keywords.get("PIXEL_PITCH") is not None:
        return keywords.number("PIXEL_PITCH")
    return _MM_PER_MICROMETRE * keywords.number("PIXEL_SIZE")


def detector_of(
    keywords: Keywords, pitch: float, first_pixel: int, origin: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return pixel and line per mm (2, 2), and pixel and line of the focal plane's origin (2,).

    Raises
    ------
    FormatError
        If neither the addendum's transform nor the directions of the axes are stated.
    """
    if keywords.get("ITRANSS") is not None:
        rows = np.array([keywords.vector("ITRANSS", 3), keywords.vector("ITRANSL", 3)])
        linear, shift = rows[:, 1:], rows[:, 0]
    elif keywords.get("SPOC_FITS_NAXIS1") is not None:
        # directions of samples and lines in the instrument's frame (OSIRIS-REx)
        axes = [keywords.vector(f"SPOC_FITS_NAXIS{axis}", 3)[:2] for axis in (1, 2)]
        linear, shift = np.array(axes) / pitch, np.zeros(2)
    else:
        raise FormatError(
            "do not state how samples and lines lie in the focal plane (ITRANSS, ITRANSL)",
            keywords.where,
            "add the instrument's addendum kernel",
        )
    if origin is not None:
        return linear, origin + shift
    if keywords.get("BORESIGHT_SAMPLE") is not None:
        stated = [keywords.number(f"BORESIGHT_{axis}") for axis in ("SAMPLE", "LINE")]
        return linear, np.array(stated) + (1 - first_pixel) + shift
    name = "CCD_CENTER" if keywords.get("CCD_CENTER") is not None else "FOV_CENTER_PIXEL"
    return linear, keywords.vector(name, 2) + 1.0 + shift


def _focal_mm(keywords: Keywords, stated: float, pitch: float) -> float:
    """Return the focal length in mm, checked by that in pixels of OpenCV's model.

    Raises
    ------
    FormatError
        If the two contradict one another.
    """
    place = f"{keywords.where}: INS{keywords.numbers[-1]}_FOCAL_LENGTH"
    if not stated > 0:
        raise FormatError(f"is {stated:g}, not above 0", place)
    ratio = float(np.mean(keywords.vector("OPENCV_OD_F", 2))) * pitch / stated
    if abs(ratio - 1.0) < 0.05:
        return stated
    if abs(ratio / _MM_PER_METRE - 1.0) < 0.05:
        return stated * _MM_PER_METRE
    raise FormatError(
        f"is {stated:g}, and OPENCV_OD_F with a pixel of {pitch:g} mm is {ratio * stated:g} mm",
        place,
    )


def _opencv(
    keywords: Keywords, k_linear: FloatArray, focal: float
) -> tuple[FloatArray, FloatArray, DistortionModel, FloatArray]:
    """Return K, origin and distortion of OpenCV's model, whose axes are samples and lines.

    Its centre is the boresight's pixel. The tangential terms (p2, p1) are a vector, which turns
    with the axes of the focal plane.
    """
    directions = k_linear / np.linalg.norm(k_linear, axis=1, keepdims=True)
    linear = keywords.vector("OPENCV_OD_F", 2)[:, None] * directions / focal
    k1, k2, k3, k4, k5, k6 = keywords.vector("OPENCV_OD_K", 6)
    p1, p2 = keywords.vector("OPENCV_OD_P", 2)
    p2, p1 = directions.T @ [p2, p1]
    coefficients = np.array([k1, k2, p1, p2, k3, k4, k5, k6])
    return linear, keywords.vector("OPENCV_OD_C", 2), "brown", coefficients


def _distortion(
    keywords: Keywords, k_linear: FloatArray, origin: FloatArray
) -> tuple[DistortionModel, FloatArray]:
    """Return model and coefficients of a mission's keywords.

    Raises
    ------
    FormatError
        If there are keywords of a distortion that is not known.
    """
    stated = keywords.text("DISTORTION_MODEL")
    if stated == "OCAMS":
        away = keywords.vector("OD_CENTER", 2) - origin
        return "ocams", np.append(np.linalg.solve(k_linear, away), keywords.vector("OD_K", 5))
    if keywords.get("TO_UNDISTORTED_X") is not None:
        return "rosetta", _osiris(keywords)
    if keywords.get("K_MATRIX") is not None and stated:
        coefficients = keywords.get("DISTORTION")
        count = 0 if coefficients is None else len(coefficients)
        # The camera refuses a model that it does not know, and another number of coefficients.
        name = cast("DistortionModel", stated.lower())
        return name, keywords.vector("DISTORTION", count) if count else np.zeros(0)
    radial = keywords.get("OD_K")
    if stated or (radial is not None and len(radial) not in (1, 3)):
        raise FormatError(
            f"{stated or radial} is no distortion that is read here",
            keywords.where,
            "known are OCAMS and OPENCV, and OD_K with one or three numbers",
        )
    if keywords.get("DECENTER") is not None:
        raise FormatError(
            "Apollo's focal plane lies behind the pupil", keywords.where, "read the ISD instead"
        )
    if radial is None:
        return "owen", np.zeros(4)
    if len(radial) == 3:
        return "radial", keywords.vector("OD_K", 3)
    if keywords.numbers[-1] not in LROC_NAC:
        raise FormatError(f"OD_K with one number is known of LROC's NAC {LROC_NAC}", keywords.where)
    return "lronac", keywords.vector("OD_K", 1)


def _osiris(keywords: Keywords) -> FloatArray:
    """Return the coefficients (35,) of Rosetta's OSIRIS: pixels from 0, x with lines."""
    pitch = _MM_PER_MICROMETRE * keywords.number("PIXEL_SIZE")
    sample, line, _ = keywords.vector("BORESIGHT", 3)
    matrices = [keywords.vector(f"TO_UNDISTORTED_{axis}", 16) for axis in "XY"]
    return np.concatenate([[pitch, line, sample], *matrices])


def _polycam_focus(keywords: Keywords, camera: Camera) -> FocusTable | None:
    """Return PolyCam's focus table; None if the kernels do not state its positions.

    Focal length and distortion are those of the last kernel for each position (v10 of the addendum
    overrules the IK's). Positions beyond infinity (17371) are left out.
    """
    rows: list[tuple[float, float, float]] = []
    shapes: list[FloatArray] = []
    for number in _POLYCAM_STEPS:
        one = Keywords(keywords.pool, (number,), keywords.suffix, keywords.where)
        if one.get("MOTOR_POSITION") is None:
            continue
        motor = one.number("MOTOR_POSITION")
        if motor > _MOTOR_AT_INFINITY:
            continue
        if one.text("DISTORTION_MODEL") == "OCAMS" and camera.distortion_model == "ocams":
            shapes.append(_distortion(one, camera.k_matrix[:, :2], camera.center)[1])
        rows.append((motor, inverse_range(motor), one.number("FOCAL_LENGTH")))
    if len(rows) < 2:
        return None
    known = np.array(shapes) if len(shapes) == len(rows) else np.zeros((0, 0))
    motor_positions, per_range, focal = np.array(rows).T
    return FocusTable(motor_positions, per_range, focal, known)


_MOTOR_AT_INFINITY = 17371.0
_MM_PER_STEP = 3.93725e-4


def inverse_range(motor: float) -> float:
    """Return one over PolyCam's focus distance, 1/m, at a motor position.

    ``1/D = −(A d − B d² + C d³)`` with d in mm of the lens; the kernel's ("Optical Parameter
    Calculations", orx_ocams_v07.ti) constants give D in mm, and 200 m at position 4231.
    """
    d = (motor - _MOTOR_AT_INFINITY) * _MM_PER_STEP
    return _MM_PER_METRE * (-8.67e-7 * d + 1.75e-8 * d * d - 2.64e-14 * d**3)
