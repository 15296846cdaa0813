"""Images of the body, rendered and written."""

from spcola.truth.imaging.files import IMAGE_FORMATS, write_image
from spcola.truth.imaging.rendering import ImageSettings, render_image

__all__ = ["IMAGE_FORMATS", "ImageSettings", "render_image", "write_image"]
