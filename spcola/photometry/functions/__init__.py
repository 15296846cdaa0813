"""Photometric functions: brightness of ground by the directions of light and view [16, 17]."""

from spcola.photometry.functions.function import PhotometricFunction
from spcola.photometry.functions.kernel import phase_terms, shade, shade_at
from spcola.photometry.functions.named import (
    PHOTOMETRIC_FUNCTIONS,
    lambert,
    lommel_seeliger,
    lunar_lambert,
    photometric_function,
)

__all__ = [
    "PHOTOMETRIC_FUNCTIONS",
    "PhotometricFunction",
    "lambert",
    "lommel_seeliger",
    "lunar_lambert",
    "phase_terms",
    "photometric_function",
    "shade",
    "shade_at",
]
