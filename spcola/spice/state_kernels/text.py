"""Text kernels that go with states of images: rotation, clock, frames, and cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import Camera, SpcImage, ray
from spcola.navigation import Spin
from spcola.spice.kernel_files import clock_items, frame_items, kernel_text, rotation_items

CLOCK_TICKS_PER_S = 10_000
"""Ticks of the clock of the kernels in a second of TDB."""


@dataclass(frozen=True)
class KernelNumbers:
    """NAIF numbers and names of what the kernels are about.

    Parameters
    ----------
    spacecraft, body : int
        The spacecraft's is negative.
    spacecraft_name, body_name : str
        In capitals.
    camera : int
        That of the first camera; the next ones count down. The clock's is one above it.
    """

    spacecraft: int
    body: int
    spacecraft_name: str
    body_name: str
    camera: int

    @property
    def clock(self) -> int:
        """Number of the clock."""
        return self.camera + 1

    def frame(self, index: int) -> str:
        """Return the name of the frame of a camera.

        Parameters
        ----------
        index : int
            From 0.
        """
        return f"{self.spacecraft_name[:14]}_SPC_{index + 1}"


def rotation_text(numbers: KernelNumbers, spin: Spin, radius_m: float) -> str:
    """Return the PCK: pole, prime meridian and radii of the body."""
    return kernel_text(
        "PCK",
        [
            "Pole and spin of the SPC solution: degrees, Julian centuries and days from J2000.",
            "The radii are the mean radius of the shape model.",
        ],
        {
            **_names({numbers.body: numbers.body_name}),
            **rotation_items(numbers.body, spin, radius_m),
        },
    )


def clock_text(numbers: KernelNumbers, start: float) -> str:
    """Return the SCLK: a clock that counts seconds of TDB evenly from an ephemeris time, s."""
    return kernel_text(
        "SCLK",
        [
            "No clock of a spacecraft: it counts TDB evenly, so that the attitudes in the CK keep",
            "the times of the images whatever clock kernel of the mission is loaded.",
        ],
        clock_items(numbers.clock, float(np.floor(start)), CLOCK_TICKS_PER_S),
    )


def frames_text(numbers: KernelNumbers, count: int) -> str:
    """Return the FK: the names, and a frame for each of some cameras, with attitudes in the CK."""
    names = {numbers.spacecraft: numbers.spacecraft_name, numbers.body: numbers.body_name}
    items: dict[str, object] = {}
    for index in range(count):
        number, frame = numbers.camera - index, numbers.frame(index)
        names[number] = frame
        items |= {
            **frame_items(frame, number, 3, number, numbers.spacecraft),
            f"CK_{number}_SCLK": numbers.clock,
            f"CK_{number}_SPK": numbers.spacecraft,
        }
    return kernel_text(
        "FK",
        ["Axes X, Y, Z of a camera's frame are Cx, Cy, Cz of SPC; Z is the boresight."],
        {**_names(names), **items},
    )


def cameras_text(numbers: KernelNumbers, examples: Sequence[SpcImage]) -> str:
    """Return the IK: an example of the images of each camera gives its interior orientation."""
    items: dict[str, object] = {}
    for index, image in enumerate(examples):
        camera, key = image.camera, f"INS{numbers.camera - index}"
        pitch = 1.0 / (camera.pixel_angle * camera.focal_length_mm)
        items |= {
            f"{key}_FOV_FRAME": f"'{numbers.frame(index)}'",
            f"{key}_FOV_CLASS_SPEC": "'CORNERS'",
            f"{key}_FOV_SHAPE": "'POLYGON'",
            f"{key}_BORESIGHT": (0.0, 0.0, 1.0),
            f"{key}_FOV_BOUNDARY_CORNERS": tuple(_corners(image).ravel()),
            f"{key}_FOCAL_LENGTH": camera.focal_length_mm,
            f"{key}_PIXEL_SAMPLES": camera.width,
            f"{key}_PIXEL_LINES": camera.height,
            f"{key}_PIXEL_PITCH": 1.0 / pitch,
            f"{key}_CCD_CENTER": tuple(camera.center - 1.0),
            f"{key}_K_MATRIX": tuple(camera.k_matrix.ravel()),
            f"{key}_ITRANSS": (0.0, *camera.k_matrix[0, :2]),
            f"{key}_ITRANSL": (0.0, *camera.k_matrix[1, :2]),
            f"{key}_DISTORTION_MODEL": f"'{camera.distortion_model.upper()}'",
        }
        if len(camera.distortion):
            items[f"{key}_DISTORTION"] = tuple(camera.distortion)
    return kernel_text(
        "IK",
        [
            "Focal length in mm; CCD_CENTER is pixel and line of the boresight, where the centre",
            "of the first pixel is (0, 0), as in NAIF's kernels; K_MATRIX (2 x 3, by rows) takes",
            "x, y (mm) and x*y to pixels and lines; ITRANSS and ITRANSL are its linear terms in",
            "the form of ISIS.",
            "DISTORTION: coefficients of the model. The field of view has the corners of the",
            "first and last pixels.",
        ],
        items,
    )


def same_camera(one: Camera, two: Camera) -> bool:
    """Return whether two cameras have the same interior orientation."""
    return (
        (one.focal_length_mm, one.width, one.height, one.distortion_model)
        == (two.focal_length_mm, two.width, two.height, two.distortion_model)
        and np.array_equal(one.center, two.center)
        and np.array_equal(one.k_matrix, two.k_matrix)
        and np.array_equal(one.distortion, two.distortion)
    )


def _corners(image: SpcImage) -> FloatArray:
    """Return the directions (4, 3) of the corners of the detector in the camera's frame."""
    right, bottom = image.camera.width + 0.5, image.camera.height + 0.5
    pixel, line = np.array([0.5, right, right, 0.5]), np.array([0.5, 0.5, bottom, bottom])
    seen: FloatArray = ray(image, pixel, line) @ image.axes.T
    return seen


def _names(names: Mapping[int, str]) -> dict[str, object]:
    """Return the assignments of names to NAIF numbers."""
    return {
        "NAIF_BODY_NAME +": tuple(f"'{name}'" for name in names.values()),
        "NAIF_BODY_CODE +": tuple(names),
    }
