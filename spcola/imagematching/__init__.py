"""Choice of images that show a maplet, and its place in them by matching."""

from spcola.imagematching.image_choice import ChoiceOptions, choose_images
from spcola.imagematching.pictures import Pictures
from spcola.imagematching.sighting import Sighting, SightOptions, agreeing, find_ground
from spcola.imagematching.sighting_sizes import SizeFactors, estimate_factors

__all__ = [
    "ChoiceOptions",
    "Pictures",
    "SightOptions",
    "Sighting",
    "SizeFactors",
    "agreeing",
    "choose_images",
    "estimate_factors",
    "find_ground",
]
