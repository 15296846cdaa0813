from .dat import read_image_data as read_image_data
from .dat import write_image_data as write_image_data
from .fits import read_fits_image as read_fits_image
from .fits import reading_fits as reading_fits
from .fits import write_fits_image as write_fits_image
