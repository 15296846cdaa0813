"""Registration of the returns themselves to SPC surfaces, without mapolas."""

from fusion.registration.returns.many_surfaces import ReturnsOptions, register_returns
from fusion.registration.returns.return_heights import (
    CloudOfReturns,
    FixedSurface,
    height_of_returns,
)
from fusion.registration.returns.returns_match import match_returns
from fusion.registration.returns.scan_fit import ScanFit, SurfaceNormalEquations

__all__ = [
    "CloudOfReturns",
    "FixedSurface",
    "ReturnsOptions",
    "ScanFit",
    "SurfaceNormalEquations",
    "height_of_returns",
    "match_returns",
    "register_returns",
]
