"""What the albedo of known ground is solved from: images and their states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.pipeline.catalog import file_digest
from fusion.pipeline.items import ItemStore
from fusion.runtime.machine import check_memory
from fusion.stages.albedo.options import AlbedoWork
from fusion.stages.bad_images import ImageUse, Outline, no_usable_image, with_right_sizes
from fusion.stages.lithos.blurs import blur_path, with_blurs
from fusion.stages.lithos.digests import ImageDigests
from fusion.stages.register import ImageScene
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.grids import Maplet, MapletGrid
from spcola.imagematching import ChoiceOptions
from spcola.photometry.albedo import AlbedoOptions, AlbedoSolution, solve_albedo
from spcola.photometry.photoclinometry import ImageFit

# Cells along a side of the ground for which images are chosen, and most squares of them.
_SIDE, _MOST_SIDES = 98, 6
# Bytes of a cell for each image, and without images.
_CELL_IMAGE_BYTES, _CELL_BYTES = 2, 200


@dataclass(frozen=True, eq=False)
class AlbedoSources:
    """Solves the albedo of ground of a workspace, piece by piece.

    Parameters
    ----------
    images : ImageScene
    items : ItemStore
    work : AlbedoWork
    digests : ImageDigests
    whole : list of MapletGrid
        All ground that images may show, in squares of about the size of a maplet.
    wrong_size : dict of str to str
        Images that are left out, as their files do not have the size of their .SUM; both in words.
    """

    images: ImageScene
    items: ItemStore
    work: AlbedoWork
    digests: ImageDigests
    whole: list[MapletGrid]
    wrong_size: dict[str, str]

    @classmethod
    def of(
        cls, workspace: Workspace, grids: list[MapletGrid], items: ItemStore, work: AlbedoWork
    ) -> AlbedoSources:
        """Read states of images that may show ground on `grids`.

        Raises
        ------
        WorkspaceError
            If no image can be used: it needs pixels of the size of its .SUM, and a state of known
            uncertainty.
        FormatError
            As :func:`with_blurs`.
        """
        images = ImageScene.of(workspace, grids, workspace.settings().registration)
        images, wrong = with_right_sizes(images)
        own = with_blurs(work.albedo.photoclinometry, workspace, work.image_blur)
        work = replace(work, albedo=replace(work.albedo, photoclinometry=own))
        images = replace(
            images,
            choice=ChoiceOptions(most=work.max_images),
            options=replace(
                images.options, function=own.function, psf_px=own.psf_px, blurs=own.blurs
            ),
        )
        whole = [part for grid in grids for part in _parts(grid)]
        if not images.images:
            raise no_usable_image(workspace, wrong, Outline.of(images.beyond, whole))
        return cls(images, items, work, ImageDigests(workspace), whole, wrong)

    def use(
        self, grids: Mapping[str, MapletGrid], fits: Mapping[str, Sequence[ImageFit]]
    ) -> ImageUse:
        """Return how images were used for ground of these grids, and fit it."""
        return ImageUse(
            self.images, self.whole, grids, fits, self.wrong_size, ground=self.work.ground
        )

    def showing(self, grid: MapletGrid) -> list[SpcImage]:
        """Return the images of a grid: of a large one those of its parts, each once."""
        found: dict[str, SpcImage] = {}
        for part in _parts(grid):
            found |= {image.name: image for image in self.images.showing(part)}
        return list(found.values())

    def input_digests(self, grids: Iterable[MapletGrid]) -> dict[str, str]:
        """Return SHA-256 of states and pixels of the images of grids, the shape, blur, by path."""
        shown = {image.name for grid in grids for image in self.showing(grid)}
        found = self.digests.files(one for one in self.images.images if one.name in shown)
        workspace = self.images.workspace
        if (path := blur_path(workspace, self.work.image_blur)) is not None:
            found[workspace.relative(path)] = file_digest(path)
        return found

    def solve(self, ground: Maplet) -> AlbedoSolution:
        """Return the albedo of ground; a kept one if nothing that goes into it changed.

        Raises
        ------
        WorkspaceError
            If this machine has too little memory for it.
        """
        images = self.showing(ground.grid)
        solver = self.work.albedo.photoclinometry.for_images(one.name for one in images)
        cells = (ground.grid.size - 1) ** 2
        check_memory(
            cells * (_CELL_BYTES + _CELL_IMAGE_BYTES * len(images)),
            f"the albedo of {ground.name} by {len(images)} images",
            "--max-images",
            "lower it, or make a smaller bigmap",
        )
        found: AlbedoSolution = self.items.result(
            self.from_images,
            replace(ground, albedo=np.ones(ground.grid.shape)),
            {image.name: self.digests.of(image) for image in images},
            self.digests.shape,
            {image.name: self.images.states[image.name] for image in images},
            replace(self.work.albedo, photoclinometry=solver),
        )
        return found

    def from_images(
        self,
        ground: Maplet,
        images: Mapping[str, str],
        shape: str,
        states: Mapping[str, FloatArray],
        options: AlbedoOptions,
    ) -> AlbedoSolution:
        """Return the albedo by what is given; images and shape are those of the digests.

        Parameters
        ----------
        ground : Maplet
            Its own albedo is not used.
        images : mapping of str to str
            Digests of state and pixels by the names of images.
        shape : str
            Digest of the shape.
        states : mapping of str to (6, 6) ndarray
        options : AlbedoOptions
        """
        known = {image.name: image for image in self.images.images}
        exposed = [self.images.exposed(known[name]) for name in images]
        return solve_albedo(ground, exposed, states, beyond=self.images.beyond, options=options)


def _parts(grid: MapletGrid) -> list[MapletGrid]:
    """Return squares that cover a grid, each about as large as a maplet: at most 36."""
    count = min(max(1, round((grid.size - 1) / _SIDE)), _MOST_SIDES)
    half = -(-grid.half_size // count)
    middles = np.linspace(-grid.half_size + half, grid.half_size - half, count)
    return [
        replace(grid, center=grid.center + grid.gsd * (y * grid.uy + x * grid.ux), half_size=half)
        for y in middles
        for x in middles
    ]
