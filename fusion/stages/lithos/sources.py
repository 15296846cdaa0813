"""What goes into one maplet: start, images, states of these, constraining heights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fusion.pipeline.catalog import file_digest
from fusion.pipeline.items import ItemStore
from fusion.scene import NearMaplets, caster_around
from fusion.stages.bad_images import ImageUse, Outline, no_usable_image, with_right_sizes
from fusion.stages.lithos.blurs import blur_path, with_blurs
from fusion.stages.lithos.constraining import ConstrainingHeights, no_shape
from fusion.stages.lithos.digests import ImageDigests
from fusion.stages.lithos.likely_functions import photometry_path, with_likely_functions
from fusion.stages.lithos.options import LithosOptions
from fusion.stages.lithos.shade import check_shade, looks_at
from fusion.stages.register import ImageScene
from fusion.workspace import Workspace
from fusion.workspace.settings.processing import RegisterSettings
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.errors import WorkspaceError
from spcola.grids import Maplet, MapletGrid
from spcola.imagematching import ChoiceOptions
from spcola.photometry.photoclinometry import (
    HeightConstraint,
    ImageFit,
    Photoclinometry,
    PhotoclinometryOptions,
    solve_photoclinometry,
)
from spcola.photometry.secondary_light import (
    SecondaryLight,
    image_in_shade,
    name_in_shade,
    name_of_image,
    secondary_light,
)
from spcola.shape import shape_heights


@dataclass(frozen=True, eq=False)
class LithosSources:
    """Solves the maplets of a workspace one by one; each depends on the parent solution alone.

    Parameters
    ----------
    workspace : Workspace
    images : ImageScene
    grids : dict of str to MapletGrid
        Of all maplets.
    heights : ConstrainingHeights
    items : ItemStore
    options : LithosOptions
    digests : ImageDigests
    chosen : dict of str to list of SpcImage
        The images of maplets, as far as they have been asked for.
    wrong_size : dict of str to str
        Images that are left out, as their files do not have the size of their .SUM; both in words.
    """

    workspace: Workspace
    images: ImageScene
    grids: dict[str, MapletGrid]
    heights: ConstrainingHeights
    items: ItemStore
    options: LithosOptions
    digests: ImageDigests
    chosen: dict[str, list[SpcImage]] = field(default_factory=dict)
    wrong_size: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, workspace: Workspace, items: ItemStore, options: LithosOptions) -> LithosSources:
        """Read states and grids.

        Raises
        ------
        WorkspaceError
            If no image can be used (it needs pixels of the size of its .SUM, and a state of known
            uncertainty), there are no maplets, or the start needs a shape and there is none.
        WorkspaceError, RejectedResultError, FormatError
            As :meth:`ConstrainingHeights.of`, :func:`with_blurs` and :func:`with_likely_functions`.
        """
        grids = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
        if not grids:
            raise WorkspaceError("has no maplets", workspace.root, "make some: spcola spc tile")
        images = ImageScene.of(workspace, list(grids.values()), RegisterSettings())
        light = options.photoclinometry.function
        solver = with_blurs(options.photoclinometry, workspace, options.image_blur)
        solver = with_likely_functions(solver, workspace)
        options = replace(options, photoclinometry=solver)
        images, wrong = with_right_sizes(images)
        images = replace(images, choice=ChoiceOptions(most=options.max_images, light=light))
        if not images.images:
            outline = Outline.of(images.beyond, grids.values())
            raise no_usable_image(workspace, wrong, outline)
        check_shade(options.secondary, images.images)
        if (options.start == "shape" or options.secondary) and images.beyond is None:
            raise no_shape(workspace, options)
        return cls(
            workspace,
            images,
            grids,
            ConstrainingHeights.of(workspace, grids, images, options),
            items,
            options,
            ImageDigests(workspace),
            wrong_size=wrong,
        )

    @property
    def centers(self) -> dict[str, FloatArray]:
        """Where each maplet lies, body-fixed, metres."""
        return {name: grid.center for name, grid in self.grids.items()}

    def input_digests(self, names: Iterable[str]) -> dict[str, str]:
        """Return SHA-256 of what maplets are solved from, except the solution's own maplets.

        Parameters
        ----------
        names : iterable of str
            Of maplets.

        Returns
        -------
        dict
            States and pixels of their images, the shape, the registration: digest by path.
        """
        shown = {image.name for name in names for image in self.showing(name)}
        shown |= set(self.options.secondary)
        # A limb may be in any image.
        every = self.heights.limbs is not None
        found = self.digests.files(one for one in self.images.images if every or one.name in shown)
        blur = blur_path(self.workspace, self.options.image_blur)
        fitted = photometry_path(self.workspace)
        paths = [*self.heights.paths, *(one for one in (blur, fitted) if one is not None)]
        return found | {self.workspace.relative(path): file_digest(path) for path in paths}

    def showing(self, name: str) -> list[SpcImage]:
        """Return the images of a maplet; they are chosen once.

        Parameters
        ----------
        name : str
        """
        if name not in self.chosen:
            self.chosen[name] = self.images.showing(self.grids[name])
        return self.chosen[name]

    def use(self, fits: Mapping[str, Sequence[ImageFit]]) -> ImageUse:
        """Return how images were used.

        Parameters
        ----------
        fits : mapping of str to sequence of ImageFit
            By the names of the maplets that were solved.
        """
        solved = {name: self.grids[name] for name in fits}
        return ImageUse(
            self.images,
            list(self.grids.values()),
            solved,
            fits,
            self.wrong_size,
            secondary=self.options.secondary,
        )

    def solve(self, name: str) -> Photoclinometry:
        """Return the photoclinometry of a maplet; a kept one if nothing that goes into it changed.

        Parameters
        ----------
        name : str
        """
        start = self.start(name)
        digests = {image.name: self.digests.of(image) for image in self.showing(name)}
        states = {image: self.images.states[image] for image in digests}
        for image in self._shaded(start.grid):
            digests[name_in_shade(image.name)] = self.digests.of(image)
            states[name_in_shade(image.name)] = self.images.states[image.name]
        found: Photoclinometry = self.items.result(
            self.from_images,
            start,
            self._around(name),
            digests,
            self.digests.shape,
            states,
            self.heights.on(start),
            self.options.photoclinometry.for_images(digests),
        )
        return found

    def start(self, name: str) -> Maplet:
        """Return heights and albedo of the first round of a maplet.

        Parameters
        ----------
        name : str
        """
        maplet = self.workspace.maplet(name)
        if self.options.start == "maplet":
            return maplet
        assert self.images.beyond is not None
        grid = maplet.grid
        height = shape_heights(self.images.beyond, grid, reach=grid.radius)
        unknown = np.full(height.shape, np.nan)
        return replace(maplet, height=height, albedo=np.ones(height.shape), sigma=unknown)

    def around(self, name: str) -> list[str]:
        """Return the maplets that are near enough to hide and shade the ground of one.

        A start from the shape uses the shape there too.

        Parameters
        ----------
        name : str
        """
        return [] if self.options.start == "shape" else self._near.around(name)

    def from_images(
        self,
        start: Maplet,
        around: tuple[Maplet, ...],
        images: Mapping[str, str],
        shape: str,
        states: Mapping[str, FloatArray],
        constraints: tuple[HeightConstraint, ...],
        options: PhotoclinometryOptions,
    ) -> Photoclinometry:
        """Return the photoclinometry of what is given; images and shape are those of the digests.

        Parameters
        ----------
        start : Maplet
        around : tuple of Maplet
            Which hide and shade its ground.
        images : mapping of str to str
            Digests of state and pixels by the names of images.
        shape : str
            Digest of the shape.
        states : mapping of str to (6, 6) ndarray
        constraints : tuple of HeightConstraint
        options : PhotoclinometryOptions
        """
        exposed, secondary = self._exposed(start, images)
        beyond = [] if self.images.beyond is None else [self.images.beyond]
        others = caster_around(around, start.grid.gsd)
        if others is not None:
            beyond.append(others)
        return solve_photoclinometry(
            start, exposed, states, constraints=constraints, beyond=beyond, secondary=secondary,
            options=options,
        )  # fmt: skip

    def _shaded(self, grid: MapletGrid) -> list[SpcImage]:
        """Return the images that look at a grid, and count where it is in the shade."""
        asked = set(self.options.secondary)
        return [one for one in self.images.images if one.name in asked and looks_at(one, grid)]

    def _exposed(
        self, start: Maplet, names: Iterable[str]
    ) -> tuple[list[SpcImage], dict[str, SecondaryLight]]:
        """Return images with their pixels, and what lights those that show ground in the shade.

        Those that would, where the Sun lights all ground, are left out.
        """
        known = {image.name: image for image in self.images.images}
        function = self.options.photoclinometry.function
        exposed, lights = list[SpcImage](), dict[str, SecondaryLight]()
        for name in names:
            image = name_of_image(name)
            if image is None:
                exposed.append(self.images.exposed(known[name]))
                continue
            assert self.images.beyond is not None
            light = secondary_light(start, known[image], self.images.beyond, function)
            if light is not None:
                exposed.append(image_in_shade(self.images.exposed(known[image])))
                lights[name] = light
        return exposed, lights

    def _around(self, name: str) -> tuple[Maplet, ...]:
        """Return the maplets with heights around one."""
        near = (self.workspace.maplet(other) for other in self.around(name))
        return tuple(maplet for maplet in near if maplet.valid.any())

    @cached_property
    def _near(self) -> NearMaplets:
        return NearMaplets(self.grids)
