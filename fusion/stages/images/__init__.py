"""Images brought into a workspace: pixels, states, catalogue, triage, and checks by the shape."""

from fusion.stages.images.candidates import isd_file
from fusion.stages.images.catalogue import count_images
from fusion.stages.images.choice import StateChoice, StateKind
from fusion.stages.images.importing import import_images
from fusion.stages.images.pixels import Recipe
from fusion.stages.images.planning import ImportOptions
from fusion.stages.images.triage import triage_images
from fusion.stages.images.turns import Turn

__all__ = [
    "ImportOptions",
    "Recipe",
    "StateChoice",
    "StateKind",
    "Turn",
    "count_images",
    "import_images",
    "isd_file",
    "triage_images",
]
