from .files import IMAGE_FORMATS as IMAGE_FORMATS
from .files import write_image as write_image
from .rendering import ImageSettings as ImageSettings
from .rendering import render as render
