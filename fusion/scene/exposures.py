"""Pixels of a workspace's images, with the last few in memory."""

from __future__ import annotations

from functools import lru_cache

from fusion.workspace import Workspace
from spcola.camera import SpcImage

# Images whose pixels are in memory at a time: neighbouring maplets lie in the same images.
_IMAGES_KEPT = 64


class Exposures:
    """Reads images with their pixels, and keeps the last few.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._read = lru_cache(_IMAGES_KEPT)(workspace.exposed)

    def __call__(self, image: SpcImage) -> SpcImage:
        """Return an image with its pixels, if it has any."""
        return self._read(image)

    def __reduce__(self) -> tuple[type[Exposures], tuple[Workspace]]:
        # Another process reads the images itself.
        return Exposures, (self._workspace,)
