"""Transforms between lidar and SPC frames: parameters, partial derivatives, covariance."""

from fusion.registration.transform.known import KnownTransform, TransformWithCovariance
from fusion.registration.transform.parameters import (
    PARAMETERS,
    Model,
    about_origin,
    natural_sizes,
    transform_partials,
    updated_transform,
)

__all__ = [
    "PARAMETERS",
    "KnownTransform",
    "Model",
    "TransformWithCovariance",
    "about_origin",
    "natural_sizes",
    "transform_partials",
    "updated_transform",
]
