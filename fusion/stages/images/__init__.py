"""Images brought into a workspace: pixels, states, catalogue, triage, and checks by the shape."""

from fusion.stages.images.catalogue import CATALOGUE, count_images, read_catalogue
from fusion.stages.images.importing import Imported, ImportOptions, import_images
from fusion.stages.images.pixels import Recipe
from fusion.stages.images.sources import StateChoice, StateKind
from fusion.stages.images.turns import Turn

__all__ = [
    "CATALOGUE",
    "ImportOptions",
    "Imported",
    "Recipe",
    "StateChoice",
    "StateKind",
    "Turn",
    "count_images",
    "import_images",
    "read_catalogue",
]
