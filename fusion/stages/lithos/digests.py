"""Digests of the images and the shape from which maplets are solved."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from fusion.pipeline.catalog import file_digest
from fusion.workspace import Workspace
from spcola.camera import SpcImage


@dataclass(frozen=True, eq=False)
class ImageDigests:
    """SHA-256 of states and pixels of images, and of the shape; each file is read once.

    Parameters
    ----------
    workspace : Workspace
    """

    workspace: Workspace
    _known: dict[str, str] = field(default_factory=dict)

    def of(self, image: SpcImage) -> str:
        """Return the digests of the state and the pixels of an image, with a space between."""
        if image.name not in self._known:
            self._known[image.name] = " ".join(map(file_digest, self._paths(image)))
        return self._known[image.name]

    @cached_property
    def shape(self) -> str:
        """Of the shape; empty if there is none."""
        path = self.workspace.shape_path() if self.workspace.has_shape() else None
        return "" if path is None else file_digest(path)

    def files(self, images: Iterable[SpcImage]) -> dict[str, str]:
        """Return the digests of all files of images, and of the shape, by path."""
        found = dict[str, str]()
        for image in images:
            for path, digest in zip(self._paths(image), self.of(image).split(), strict=True):
                found[f"{path.parent.name}/{path.name}"] = digest
        if self.shape:
            path = self.workspace.shape_path()
            found[f"{path.parent.name}/{path.name}"] = self.shape
        return found

    def _paths(self, image: SpcImage) -> tuple[Path, Path]:
        return self.workspace.image_path(image.name), self.workspace.exposure_path(image.name)
