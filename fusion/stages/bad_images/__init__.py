"""Images that cannot be used, why, and what to do, for all commands that solve ground."""

from fusion.stages.bad_images.files import no_usable_image, with_right_sizes
from fusion.stages.bad_images.findings import ImageUse, image_findings
from fusion.stages.bad_images.outlines import Outline

__all__ = ["ImageUse", "Outline", "image_findings", "no_usable_image", "with_right_sizes"]
