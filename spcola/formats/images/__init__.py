"""Image files: .DAT and FITS of SPC, and images of missions in their own formats."""

from spcola.formats.images.dat import read_image_data, write_image_data
from spcola.formats.images.fits import read_fits_image, reading_fits, write_fits_image
from spcola.formats.images.image_file import ImageFile
from spcola.formats.images.image_label import ImageLabel
from spcola.formats.images.isis_tables import read_isis_tables
from spcola.formats.images.open_image import open_image

__all__ = [
    "ImageFile",
    "ImageLabel",
    "open_image",
    "read_fits_image",
    "read_image_data",
    "read_isis_tables",
    "reading_fits",
    "write_fits_image",
    "write_image_data",
]
