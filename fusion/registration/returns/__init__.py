"""Registration of the returns themselves to SPC surfaces, without mapolas."""

from fusion.registration.returns.by_returns import SurfaceNormalEquations, surface_equations
from fusion.registration.returns.direct import DirectRegistration
from fusion.registration.returns.equations import Equations, modelled_covariance
from fusion.registration.returns.many_surfaces import ReturnsOptions, register_returns
from fusion.registration.returns.return_heights import (
    CloudOfReturns,
    FixedSurface,
    height_of_returns,
)
from fusion.registration.returns.returns_match import match_returns

__all__ = [
    "CloudOfReturns",
    "DirectRegistration",
    "Equations",
    "FixedSurface",
    "ReturnsOptions",
    "SurfaceNormalEquations",
    "height_of_returns",
    "match_returns",
    "modelled_covariance",
    "register_returns",
    "surface_equations",
]
