"""The transform from matches: rigid, similarity, affine; covariance and stability."""

from fusion.registration.fit.fit import (
    PARAMETERS,
    FitOptions,
    Model,
    Registration,
    about_origin,
    fit_transform,
    natural_sizes,
    similarity_numbers,
    transform_partials,
    updated_transform,
)
from fusion.registration.fit.known import KnownTransform
from fusion.registration.fit.landmarks import LandmarkErrors

__all__ = [
    "PARAMETERS",
    "FitOptions",
    "KnownTransform",
    "LandmarkErrors",
    "Model",
    "Registration",
    "about_origin",
    "fit_transform",
    "natural_sizes",
    "similarity_numbers",
    "transform_partials",
    "updated_transform",
]
