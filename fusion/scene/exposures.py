"""Pixels of a workspace's images, with the last few in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fusion.workspace import Workspace
from spcola.arrays import AnyArray
from spcola.camera import SpcImage
from spcola.camera.detector import Orientation

# Images whose pixels are in memory at a time: neighbouring maplets lie in the same images.
_IMAGES_KEPT = 64


class Exposures:
    """Reads images with their pixels, and keeps the last few.

    Parameters
    ----------
    workspace : Workspace
    turned : mapping of str to Orientation, optional
        By their names: of images whose pixels are taken mirrored or turned.
    """

    def __init__(
        self, workspace: Workspace, turned: Mapping[str, Orientation] | None = None
    ) -> None:
        self._workspace = workspace
        self._turned = dict(turned or {})
        self._read = lru_cache(_IMAGES_KEPT)(workspace.exposed)

    def __call__(self, image: SpcImage) -> SpcImage:
        """Return an image with its pixels, if it has any."""
        read = self._read(image)
        orientation = self._turned.get(image.name)
        if orientation is None or read.pixels is None:
            return read
        pixels: AnyArray = np.ascontiguousarray(orientation.apply(read.pixels))
        return replace(read, pixels=pixels)

    def __reduce__(self) -> tuple[type[Exposures], tuple[Workspace, dict[str, Orientation]]]:
        # Another process reads the images itself.
        return Exposures, (self._workspace, self._turned)
