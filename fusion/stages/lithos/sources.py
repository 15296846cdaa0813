"""What goes into one maplet: start, images, states of these, constraining heights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fusion.estimation.verdict import Verdict
from fusion.fusing import gives_means
from fusion.pipeline.catalog import file_digest
from fusion.pipeline.items import ItemStore
from fusion.scene import Scene, maplets_around
from fusion.scene.geolocation import return_paths
from fusion.stages.lithos.digests import ImageDigests
from fusion.stages.lithos.limbs import Limbs
from fusion.stages.lithos.maps import ExternalMap, read_maps
from fusion.stages.lithos.options import ConstraintKind, LithosOptions
from fusion.stages.lithos.returns import RegisteredReturns
from fusion.stages.lithos.shade import check_shade, looks_at
from fusion.stages.register import ImageScene
from fusion.workspace import Workspace
from fusion.workspace.settings.processing import RegisterSettings
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.errors import RejectedResultError, WorkspaceError
from spcola.grids import Maplet, MapletGrid, project_maplet
from spcola.imagematching import ChoiceOptions
from spcola.photometry.photoclinometry import (
    HeightConstraint,
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
from spcola.shape import RayCaster, shape_heights
from spcola.shape.tiling import mesh_of_maplets

# Points of a shape, and of a maplet, that share one error; of a coarser one, its own points.
_COMMON_SHAPE, _COMMON_MAPLET = 100.0, 400.0
# Maplets that reach to within so many radii of the centre of another may hide and shade its ground;
# their facets there have a side of so many of its GSDs.
_AROUND, _AROUND_STEP = 3.0, 2.0
# Sigmas of the shape that a limb may lie from the shape's.
_FARTHEST = 3.0
# A maplet whose GSD is larger by this factor is a coarser one.
_COARSER = 1.5
# Sigma of the heights of a maplet that states none, grid steps.
_MAPLET_SIGMA = 0.5


@dataclass(frozen=True, eq=False)
class LithosSources:
    """Solves the maplets of a workspace one by one; each depends on the parent solution alone.

    Parameters
    ----------
    workspace : Workspace
    images : ImageScene
    grids : dict of str to MapletGrid
        Of all maplets.
    scene : Scene, optional
        Registered mapolas; only where the lidar is asked for.
    returns : RegisteredReturns, optional
        Only where they are asked for.
    limbs : Limbs, optional
        Only where they are asked for.
    maps : tuple of ExternalMap
    items : ItemStore
    options : LithosOptions
    digests : ImageDigests
    chosen : dict of str to list of SpcImage
        The images of maplets, as far as they have been asked for.
    """

    workspace: Workspace
    images: ImageScene
    grids: dict[str, MapletGrid]
    scene: Scene | None
    returns: RegisteredReturns | None
    limbs: Limbs | None
    maps: tuple[ExternalMap, ...]
    items: ItemStore
    options: LithosOptions
    digests: ImageDigests
    chosen: dict[str, list[SpcImage]] = field(default_factory=dict)

    @classmethod
    def of(cls, workspace: Workspace, items: ItemStore, options: LithosOptions) -> LithosSources:
        """Read states and grids.

        Raises
        ------
        WorkspaceError
            If no image has both pixels and a state of known uncertainty, there are no maplets, the
            shape is asked for and there is none, or the lidar and it is not registered.
        RejectedResultError
            If the lidar is asked for, and its registration may not be used, or its mapolas are too
            coarse for the maplets.
        FormatError
            If a map cannot be read, or states no sigma.
        """
        grids = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
        if not grids:
            raise WorkspaceError("has no maplets", workspace.root, "make some: spcola spc tile")
        images = ImageScene.of(workspace, list(grids.values()), RegisterSettings())
        light = options.photoclinometry.function
        images = replace(images, choice=ChoiceOptions(most=options.max_images, light=light))
        if not images.images:
            raise WorkspaceError(
                "no image has both pixels and a state of known uncertainty",
                workspace.root / "IMAGEFILES",
                "bring images and states: spcola images",
            )
        check_shade(options.secondary, images.images)
        of_shape = {ConstraintKind.SHAPE, ConstraintKind.LIMBS}
        shape = of_shape & set(options.constraints) or options.start == "shape"
        if (shape or options.secondary) and images.beyond is None:
            raise WorkspaceError(
                "has no shape", workspace.root, "leave it out: --start maplet --constraint overlaps"
            )
        asked = options.constraints
        if {ConstraintKind.LIDAR, ConstraintKind.RETURNS} & set(asked):
            check_registration(workspace, options.accepted)
        lidar, returns = ConstraintKind.LIDAR in asked, ConstraintKind.RETURNS in asked
        return cls(
            workspace,
            images,
            grids,
            _mapolas(workspace, grids) if lidar else None,
            RegisteredReturns.of(workspace) if returns else None,
            Limbs(images, _reach(options, grids)) if ConstraintKind.LIMBS in asked else None,
            read_maps(options.maps, options.map_sigma_m),
            items,
            options,
            ImageDigests(workspace),
        )

    @property
    def centers(self) -> dict[str, FloatArray]:
        """Where each maplet lies, body-fixed, metres."""
        return {name: grid.center for name, grid in self.grids.items()}

    @property
    def constraint_names(self) -> list[str]:
        """Constraints that other data than maplets give, by the names of their heights."""
        given = {"lidar": self.scene, "returns": self.returns, "limbs": self.limbs}
        named = [name for name, source in given.items() if source is not None]
        return named + [one.name for one in self.maps]

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
        every = self.limbs is not None
        found = self.digests.files(one for one in self.images.images if every or one.name in shown)
        if self.scene is not None or self.returns is not None:
            path = self.workspace.registration_path
            found[path.name] = file_digest(path)
        if self.returns is not None:
            paths = return_paths(self.workspace, self.workspace.settings())
            if self.returns.source.adjustment is not None:
                paths.append(self.workspace.adjustment_path)
            found |= {self.workspace.relative(one): file_digest(one) for one in paths}
        found |= {self.workspace.relative(one.path): file_digest(one.path) for one in self.maps}
        return found

    def showing(self, name: str) -> list[SpcImage]:
        """Return the images of a maplet; they are chosen once.

        Parameters
        ----------
        name : str
        """
        if name not in self.chosen:
            self.chosen[name] = self.images.showing(self.grids[name])
        return self.chosen[name]

    def solve(self, name: str) -> Photoclinometry:
        """Return the photoclinometry of a maplet; a kept one if nothing that goes into it changed.

        Parameters
        ----------
        name : str
        """
        start = self._start(name)
        digests = {image.name: self.digests.of(image) for image in self.showing(name)}
        states = {image: self.images.states[image] for image in digests}
        for image in self._shaded(start.grid):
            digests[name_in_shade(image.name)] = self.digests.of(image)
            states[name_in_shade(image.name)] = self.images.states[image.name]
        found: Photoclinometry = self.items.result(
            self.from_images,
            start,
            self._around(start),
            digests,
            self.digests.shape,
            states,
            self._constraints(start),
            self.options.photoclinometry,
        )
        return found

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
        if around:
            beyond.append(RayCaster(mesh_of_maplets(around, _AROUND_STEP * start.grid.gsd)))
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

    def _around(self, start: Maplet) -> tuple[Maplet, ...]:
        """Return the maplets with heights that are near enough to hide and shade its ground.

        A start from the shape uses the shape there too.
        """
        if self.options.start == "shape":
            return ()
        own = start.grid
        near = (
            self.workspace.maplet(name)
            for name, grid in self.grids.items()
            if name != start.name
            and np.linalg.norm(grid.center - own.center) < grid.radius + _AROUND * own.radius
        )
        return tuple(maplet for maplet in near if maplet.valid.any())

    def _start(self, name: str) -> Maplet:
        maplet = self.workspace.maplet(name)
        if self.options.start == "maplet":
            return maplet
        height = self._shape_heights(maplet.grid)
        unknown = np.full(height.shape, np.nan)
        return replace(maplet, height=height, albedo=np.ones(height.shape), sigma=unknown)

    def _shape_heights(self, grid: MapletGrid) -> FloatArray:
        assert self.images.beyond is not None
        return shape_heights(self.images.beyond, grid, reach=grid.radius)

    def _constraints(self, start: Maplet) -> tuple[HeightConstraint, ...]:
        """Return the constraining heights, in the order of their kinds."""
        kinds, grid = self.options.constraints, start.grid
        found = list[HeightConstraint]()
        if ConstraintKind.SHAPE in kinds:
            sigma = self.options.shape_sigma_m or grid.gsd
            heights = self._shape_heights(grid)
            found.append(HeightConstraint.of_sigma("shape", heights, sigma, common=_COMMON_SHAPE))
        if {ConstraintKind.OVERLAPS, ConstraintKind.COARSER} & set(kinds):
            found += [
                _overlap(other, grid)
                for other in maplets_around(self.workspace, self.grids, grid)
                if other.name != start.name and _kind_of(other.grid, grid) in kinds
            ]
        if self.scene is not None:
            lidar = self.scene.lidar(start.name, grid)
            found.append(HeightConstraint.of_sigma("lidar", lidar.height, lidar.sigma))
        if self.returns is not None:
            sigma = self.options.photoclinometry.slope_sigma
            found.append(self.returns.constraint(start, sigma))
        if self.limbs is not None:
            limbs = self.limbs.constraint(start, self.options.photoclinometry.slope_sigma)
            found += [] if limbs is None else [limbs]
        found += [one for one in (map_.constraint(start) for map_ in self.maps) if one is not None]
        return tuple(found)


def registered_scene(workspace: Workspace, accepted: tuple[str, ...]) -> Scene:
    """Return the registered mapolas; refused as the fusion refuses them.

    Raises
    ------
    WorkspaceError, RejectedResultError
        As :func:`check_registration`.
    """
    check_registration(workspace, accepted)
    return Scene.of(workspace, light="none")


def check_registration(workspace: Workspace, accepted: tuple[str, ...]) -> None:
    """Refuse a registration that the fusion would refuse.

    Raises
    ------
    WorkspaceError
        If there is none.
    RejectedResultError
        If the registration may not be used; `accepted` are codes of findings that may.
    """
    path = workspace.registration_path
    if not path.is_file():
        raise WorkspaceError(
            "has no registered lidar", workspace.root, f"run: spcola register {workspace.root}"
        )
    verdict = Verdict.from_json(workspace.read_json(path.name))
    if obstacle := verdict.obstacle(accepted):
        raise RejectedResultError(f"the registration is {obstacle}", path)


def _mapolas(workspace: Workspace, grids: Mapping[str, MapletGrid]) -> Scene:
    """Return the registered mapolas, if heights of some can constrain maplets."""
    scene = Scene.of(workspace, light="none")
    finest = min(scene.mapola_grids.values(), key=lambda grid: grid.gsd)
    if all(gives_means(finest, grid) for grid in grids.values()):
        raise RejectedResultError(
            f"mapolas of {finest.gsd:.3g} m are coarser than all maplets, and have no heights of "
            "their points",
            workspace.root / "mapolas",
            "use the returns themselves: --constraint returns, or [lithos] constraints",
        )
    return scene


def _reach(options: LithosOptions, grids: Mapping[str, MapletGrid]) -> float:
    """Return how far limbs may lie from the shape's, metres."""
    sigma = options.shape_sigma_m or float(np.median([grid.gsd for grid in grids.values()]))
    return _FARTHEST * sigma


def _kind_of(other: MapletGrid, grid: MapletGrid) -> ConstraintKind:
    """Return as what a maplet of another grid constrains."""
    coarser = other.gsd > _COARSER * grid.gsd
    return ConstraintKind.COARSER if coarser else ConstraintKind.OVERLAPS


def _overlap(other: Maplet, grid: MapletGrid) -> HeightConstraint:
    """Return the heights of an overlapping maplet on a grid [24 – 27]."""
    there = project_maplet(other, grid)
    sigma = np.where(np.isfinite(there.sigma), there.sigma, _MAPLET_SIGMA * other.grid.gsd)
    common = _COMMON_MAPLET * max(1.0, other.grid.gsd / grid.gsd) ** 2
    return HeightConstraint.of_sigma(other.name, there.height, sigma, common=common)
