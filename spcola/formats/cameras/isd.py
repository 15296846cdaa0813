"""Cameras and states from ISD JSON, as ALE writes it for ISIS and CSM.

Conventions. CSM and ISD number lines and samples from the upper left corner of the first pixel, so
that its centre is (0.5, 0.5); ISIS and SPC have (1, 1) there. The times of lines are stated by
ISIS's numbers (the first line begins at 0.5). Tables of states are in kilometres in J2000, with
SPICE's quaternions (scalar first) that turn J2000 into the frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import Camera, DistortionModel
from spcola.camera.linescan import LineScan
from spcola.camera.models import turned_metric_camera
from spcola.errors import FormatError
from spcola.formats.states.isd import isd_states
from spcola.formats.text.fields import Fields
from spcola.formats.text.source import as_format_error

_FRAME = "USGS_ASTRO_FRAME_SENSOR_MODEL"
_LINES = "USGS_ASTRO_LINE_SCANNER_SENSOR_MODEL"


@dataclass(frozen=True, eq=False)
class IsdSensor:
    """What an ISD states of one image.

    Parameters
    ----------
    camera : Camera
        Interior orientation in SPC's convention.
    times : (N,) ndarray
        Ephemeris times, s: one of a frame camera, one of each line of a line scanner.
    positions : (N, 3) ndarray
        Of the sensor, body-fixed, metres.
    axes : (N, 3, 3) ndarray
        Rows Cx, Cy, Cz, body-fixed.
    """

    camera: Camera
    times: FloatArray
    positions: FloatArray
    axes: FloatArray

    def line_scan(self) -> LineScan:
        """Return the image of a line scanner.

        Raises
        ------
        InvalidValueError
            If it is a frame camera: there is one state.
        """
        return LineScan(self.camera, self.times, self.positions, self.axes)


def read_isd(
    path: str | Path,
    *,
    optical_axis: tuple[float, float] | None = None,
    summing: float | None = None,
    pointing: Literal["slerp", "cubic"] = "slerp",
) -> IsdSensor:
    """Read an ISD of a frame camera or a line scanner.

    Apollo's metric camera (keywords PP, OD_K, DECENTER) gets its "hasselblad" distortion, which
    CSM's own fields do not contain; its focal plane lies behind the pupil in ISIS, and is turned
    about x so that Cz looks at the ground.

    Parameters
    ----------
    path : str or Path
    optical_axis : (2,) of float, optional
        Pixel and line of the origin of the focal plane, the first pixel's centre being (1, 1),
        where the file does not state it. The only line of a line scanner is line 1.
    summing : float, optional
        Detector pixels in a pixel of the image, where the file is wrong (scans of Apollo's film
        that were reduced after scanning).
    pointing : {"slerp", "cubic"}
        Between two attitudes: a turn at a constant rate, as ISIS has it, or a smooth spline.

    Raises
    ------
    FormatError
        If the file is no ISD, a field is missing or unusable, or its sensor or distortion is of
        another type.
    """
    fields = Fields.read_json(path)
    model = fields.text("name_model")
    if model not in (_FRAME, _LINES):
        raise FormatError(
            f"is of a {model}", fields.where("name_model"), "frames and line scanners are read"
        )
    scanner = model == _LINES
    with as_format_error(str(path)):
        camera, mirrored = _camera(fields, scanner, optical_axis, summing)
    times = _line_times(fields) if scanner else np.array([fields.number("center_ephemeris_time")])
    with as_format_error(str(path)):
        positions, axes = _states(fields, times, pointing)
    if mirrored:
        axes = np.diag([1.0, -1.0, -1.0]) @ axes
    return IsdSensor(camera, times, positions, axes)


def _camera(
    fields: Fields, scanner: bool, axis: tuple[float, float] | None, summing: float | None
) -> tuple[Camera, bool]:
    """Return the interior orientation, and whether its y and z are turned against ISIS's."""
    per_mm = np.array(
        [fields.vector("focal2pixel_samples", 3), fields.vector("focal2pixel_lines", 3)]
    )
    sums = np.array(
        [fields.number("detector_sample_summing"), fields.number("detector_line_summing")]
        if summing is None
        else [summing, summing]
    )
    if scanner:
        # The image's lines follow one another in time; the detector has the only line 1.
        sums[1] = 1.0
    if axis is None:
        corner = np.array([0.5, 1.0 if scanner else 0.5])
        axis = tuple((_origin(fields) + per_mm[:, 0]) / sums + corner)
    k_matrix = np.column_stack([per_mm[:, 1:] / sums[:, None], np.zeros(2)])
    model, coefficients, mirrored = _distortion(fields)
    if mirrored:
        k_matrix[:, 1] *= -1.0
    size = [fields.whole(name) for name in ("image_samples", "image_lines")]
    camera = Camera(
        fields.number("focal_length_model.focal_length"),
        np.array(axis),
        k_matrix,
        size[0],
        1 if scanner else size[1],
        model,
        coefficients,
    )
    return camera, mirrored


def _origin(fields: Fields) -> FloatArray:
    """Return sample and line (2,) of the focal plane's origin in the image's part of the detector.

    Raises
    ------
    FormatError
        If it is not stated.
    """
    found = []
    for name in ("sample", "line"):
        if fields.get(f"detector_center.{name}") is None:
            raise FormatError(
                "is not stated", fields.where(f"detector_center.{name}"), "give the optical axis"
            )
        start = fields.number(f"starting_detector_{name}")
        found.append(fields.number(f"detector_center.{name}") - start)
    return np.array(found)


def _distortion(fields: Fields) -> tuple[DistortionModel, FloatArray, bool]:
    """Return model and coefficients, and whether the focal plane is turned.

    Raises
    ------
    FormatError
        If the model is not known.
    """
    apollo = _apollo(fields)
    if apollo is not None:
        return "hasselblad", apollo, True
    stated = fields.get("optical_distortion")
    kind = next(iter(stated), "") if isinstance(stated, dict) else ""
    place = f"optical_distortion.{kind}"
    if kind == "radial":
        return "radial", fields.vector(f"{place}.coefficients", 3), False
    if kind == "transverse":
        both = [fields.vector(f"{place}.{axis}", 10) for axis in "xy"]
        return "transverse", np.concatenate(both), False
    if kind == "lrolrocnac":
        return "lronac", fields.vector(f"{place}.coefficients", 1), False
    if kind == "dawnfc":
        # x (1 + k r²): the first term of Owen's model
        return "owen", np.append(fields.vector(f"{place}.coefficients", 1), np.zeros(3)), False
    raise FormatError(
        f"{kind!r} is not read",
        fields.where("optical_distortion"),
        "known are radial, transverse, lrolrocnac and dawnfc",
    )


def _apollo(fields: Fields) -> FloatArray | None:
    """Return the distortion of Apollo's metric camera (8,) from the kernel's keywords, if any."""
    keywords = fields.get("naif_keywords")
    names = [name for name in keywords or () if name.endswith("_DECENTER")]
    if not names:
        return None
    head = f"naif_keywords.{names[0].removesuffix('_DECENTER')}"
    return turned_metric_camera(
        fields.vector(f"{head}_PP", 2),
        fields.vector(f"{head}_OD_K", 3),
        fields.vector(f"{head}_DECENTER", 3),
    )


def _line_times(fields: Fields) -> FloatArray:
    """Return the times (L,) of the lines' mid-exposures, s.

    Each row of ``line_scan_rate`` states a line (the first begins at 0.5), its time from the
    centre, and the time of a line.
    """
    count = fields.whole("image_lines")
    rates = fields.table("line_scan_rate", 3)
    line = np.arange(1, count + 1)
    part = np.clip(np.searchsorted(rates[:, 0], line, side="right") - 1, 0, None)
    start, since_center, duration = rates[part].T
    found: FloatArray = (
        fields.number("center_ephemeris_time") + since_center + duration * (line - start)
    )
    return found


def _states(
    fields: Fields, times: FloatArray, pointing: Literal["slerp", "cubic"]
) -> tuple[FloatArray, FloatArray]:
    """Return positions (N, 3), m, and ISIS's axes (N, 3, 3), body-fixed, at times (N,)."""
    tables = isd_states(fields)
    with as_format_error():
        return tables.along(times, method=pointing)
