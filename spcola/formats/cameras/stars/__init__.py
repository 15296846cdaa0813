"""Files of a star calibration: catalogue, measured positions, attitudes, images."""

from spcola.formats.cameras.stars.image import read_star_image
from spcola.formats.cameras.stars.tables import (
    NominalAttitude,
    read_attitudes,
    read_star_catalogue,
    read_star_positions,
)

__all__ = [
    "NominalAttitude",
    "read_attitudes",
    "read_star_catalogue",
    "read_star_image",
    "read_star_positions",
]
