"""The parameters of a camera that stars determine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.camera import Camera, DistortionModel
from spcola.camera.distortion import COEFFICIENTS
from spcola.camera.models import MODELS
from spcola.errors import InvalidValueError

# Coefficients that neither focal length, K-matrix nor attitude takes the place of.
_FREE: dict[str, tuple[int, ...]] = {
    "bicubic": (*range(3, 10), *range(13, 20)),
    "transverse": (*range(3, 10), *range(13, 20)),
    "hasselblad": (2, 3, 4, 5, 6),
    "radial": (1, 2),
    "rosetta": tuple(
        start + 4 * j + i
        for start in (3, 19)
        for j in range(4)
        for i in range(4)
        if 2 <= i + j <= 3
    ),
    "hayabusa2": (2, 3),
    "ocams": (3, 4, 5, 6),
}
_NEEDS_A_CAMERA = ("rosetta", "hayabusa2")


@dataclass(frozen=True)
class SolvedParameters:
    """Which parameters are solved; their names and how they change a camera.

    Kxx is fixed, as it is the measured size of a pixel (Gaskell et al., §2.2), and Kyx, as every
    image's twist takes its place. The centre is fixed unless it is asked for: an image's attitude
    takes its place in all but wide fields.

    Parameters
    ----------
    names : tuple of str
        Of ``focal_length_mm``, ``k_xy``, ``k_yy``, ``center_pixel``, ``center_line``,
        ``distortion[0]`` …
    """

    names: tuple[str, ...]

    def value(self, camera: Camera) -> FloatArray:
        """Return the parameters (P,) of a camera."""
        return np.array([_get(camera, name) for name in self.names])

    def applied(self, camera: Camera, values: FloatArray) -> Camera:
        """Return the camera with other parameters (P,)."""
        center, k_matrix = camera.center.copy(), camera.k_matrix.copy()
        distortion, focal = camera.distortion.copy(), camera.focal_length_mm
        for name, value in zip(self.names, values.tolist(), strict=True):
            if name == "focal_length_mm":
                focal = value
            elif name in _PLACES:
                table, place = _PLACES[name]
                (center if table == "center" else k_matrix)[place] = value
            else:
                distortion[_index(name)] = value
        return replace(
            camera, focal_length_mm=focal, center=center, k_matrix=k_matrix, distortion=distortion
        )

    def steps(self, camera: Camera) -> FloatArray:
        """Return steps (P,) of finite differences: each moves the corner by about 0.01 pixel."""
        radius = 0.5 * np.hypot(camera.width, camera.height)
        half_mm = radius * camera.pixel_angle * camera.focal_length_mm
        found = []
        for name in self.names:
            if name == "focal_length_mm":
                found.append(1e-2 * camera.focal_length_mm / radius)
            elif name.startswith("k_"):
                found.append(1e-2 / half_mm)
            elif name.startswith("center"):
                found.append(1e-2)
            else:
                found.append(_coefficient_step(camera, _index(name), half_mm))
        return np.array(found)


_PLACES: dict[str, tuple[str, int | tuple[int, int]]] = {
    "k_xy": ("k_matrix", (0, 1)),
    "k_yy": ("k_matrix", (1, 1)),
    "center_pixel": ("center", 0),
    "center_line": ("center", 1),
}


def solved_parameters(
    camera: Camera, *, k_matrix: bool = True, center: bool = False, distortion: bool = True
) -> SolvedParameters:
    """Return the parameters to solve for a camera.

    Parameters
    ----------
    camera : Camera
    k_matrix, center, distortion : bool
        Whether Kxy and Kyy, the centre, and the distortion are solved. Coefficients that the focal
        length, K-matrix or attitude take the place of are fixed (constant and linear terms).
    """
    names = ["focal_length_mm"]
    names += ["k_xy", "k_yy"] if k_matrix else []
    names += ["center_pixel", "center_line"] if center else []
    if distortion:
        free = _FREE.get(camera.distortion_model, range(len(camera.distortion)))
        names += [f"distortion[{number}]" for number in free]
    return SolvedParameters(tuple(names))


def with_model(camera: Camera, model: DistortionModel | None) -> Camera:
    """Return the camera with another model of distortion, starting from none.

    Raises
    ------
    InvalidValueError
        If the model needs coefficients that only the camera's file can state.
    """
    if model is None or model == camera.distortion_model:
        return camera
    if model in _NEEDS_A_CAMERA:
        raise InvalidValueError(
            f"{model} needs a pixel size among its coefficients",
            "distortion",
            "state them in the camera",
        )
    zeros = np.zeros(min(COEFFICIENTS[model]))
    if model == "transverse":
        zeros[[1, 12]] = 1.0
    return replace(camera, distortion_model=model, distortion=zeros)


def _get(camera: Camera, name: str) -> float:
    if name == "focal_length_mm":
        return camera.focal_length_mm
    if name in _PLACES:
        table, place = _PLACES[name]
        return float((camera.center if table == "center" else camera.k_matrix)[place])
    return float(camera.distortion[_index(name)])


def _index(name: str) -> int:
    return int(name.removeprefix("distortion[").removesuffix("]"))


def _coefficient_step(camera: Camera, index: int, half_mm: float) -> float:
    """Return the step of a coefficient that moves the corner by about 0.01 pixel.

    Models are linear in their coefficients, or nearly so.
    """
    form = MODELS[camera.distortion_model]
    corner = np.array([half_mm * 0.8]), np.array([half_mm * 0.6])
    other = camera.distortion.copy()
    other[index] += 1.0
    before = form.shift(camera.distortion, *corner, camera.focal_length_mm)
    after = form.shift(other, *corner, camera.focal_length_mm)
    moved = float(np.hypot(*(b[0] - a[0] for a, b in zip(before[:2], after[:2], strict=True))))
    return 1e-2 * camera.pixel_angle * camera.focal_length_mm / moved
