"""Normal equations of a transform from two gridded surfaces, and their result."""

from fusion.registration.direct.direct_registration import DirectRegistration
from fusion.registration.direct.equations import (
    Clusters,
    NormalEquations,
    SurfacePair,
    modelled_covariance,
    pair_equations,
)

__all__ = [
    "Clusters",
    "DirectRegistration",
    "NormalEquations",
    "SurfacePair",
    "modelled_covariance",
    "pair_equations",
]
