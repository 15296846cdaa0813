"""Parameters of photometric functions fitted to images of known ground."""

from spcola.photometry.fitting.comparison import Standing, compare_fits
from spcola.photometry.fitting.fit import Doubt, PhotometricFit, fit_function
from spcola.photometry.fitting.samples import (
    BlockSamples,
    PhotometricSamples,
    SampleOptions,
    sample_blocks,
)

__all__ = [
    "BlockSamples",
    "Doubt",
    "PhotometricFit",
    "PhotometricSamples",
    "SampleOptions",
    "Standing",
    "compare_fits",
    "fit_function",
    "sample_blocks",
]
