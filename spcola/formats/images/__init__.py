"""Image files: .DAT and FITS."""

from spcola.formats.images.dat import read_image_data, write_image_data
from spcola.formats.images.fits import read_fits_image, reading_fits, write_fits_image

__all__ = [
    "read_fits_image",
    "read_image_data",
    "reading_fits",
    "write_fits_image",
    "write_image_data",
]
