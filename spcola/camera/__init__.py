"""Cameras: from body-fixed points to pixels and back."""

from spcola.camera.camera import Camera, DistortionModel
from spcola.camera.image import ImagePoint, SpcImage
from spcola.camera.projection import (
    partials_position,
    partials_rotation,
    project_image,
    ray,
    rotate_axes,
)

__all__ = [
    "Camera",
    "DistortionModel",
    "ImagePoint",
    "SpcImage",
    "partials_position",
    "partials_rotation",
    "project_image",
    "ray",
    "rotate_axes",
]
