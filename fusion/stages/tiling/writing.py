"""Files of new maplets: .MAP and .LMK, and the lists and states that name them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fusion.stages.tiling.naming import free_letters, free_names
from fusion.stages.tiling.options import TilingOptions
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import ImagePoint
from spcola.control import Landmark, map_overlap, overlaps_of
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_landmark, write_list, write_summary
from spcola.grids import MapletGrid
from spcola.shape.tiling import Seed

_MAPLET_SUFFIXES = (".MAP", ".SIG", ".ASG", ".SSG", ".SDR")


@dataclass(frozen=True, eq=False)
class Tile:
    """What stays in memory of a new maplet.

    Parameters
    ----------
    name : str
    grid : MapletGrid
    sigma : (3,) ndarray
        One standard deviation of V, metres.
    stated : bool
        Whether the sigma comes from the maplets that seeded it.
    pictures : tuple of ImagePoint
    seed : tuple of str
        Maplets that seeded it.
    shares : (float, float)
        Of points with heights of maplets, and of the shape.
    """

    name: str
    grid: MapletGrid
    sigma: FloatArray
    stated: bool
    pictures: tuple[ImagePoint, ...]
    seed: tuple[str, ...]
    shares: tuple[float, float]


@dataclass(frozen=True)
class Replaced:
    """Coarser maplets that a new solution does not have."""

    names: frozenset[str] = frozenset()

    @property
    def files(self) -> frozenset[str]:
        """Their files, by folder."""
        maps = {f"MAPFILES/{name}{suffix}" for name in self.names for suffix in _MAPLET_SUFFIXES}
        return frozenset(maps | {f"LMKFILES/{name}.LMK" for name in self.names})


def replaced_maplets(grids: Mapping[str, MapletGrid], options: TilingOptions) -> Replaced:
    """Return the maplets that new ones replace: those whose square lies in the region.

    Parameters
    ----------
    grids : mapping of str to MapletGrid
        Of the coarser maplets.
    options : TilingOptions
    """
    if not options.replace:
        return Replaced()
    circle = options.circle
    if circle is None:
        return Replaced(frozenset(grids))
    return Replaced(
        frozenset(name for name, grid in grids.items() if circle.holds(_corners(grid)).all())
    )


def _corners(grid: MapletGrid) -> FloatArray:
    """Return the corners (4, 3) of a grid, metres."""
    half = grid.half_size * grid.gsd
    signs = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    corners: FloatArray = grid.center + half * signs @ grid.axes[:2]
    return corners


class NewMaplets:
    """Names and writes the maplets of a tiling, one after the other.

    Parameters
    ----------
    workspace : Workspace
        Whose names are taken.
    folder : Path
        Of the new solution.
    options : TilingOptions
    usual_sigma : float
        One standard deviation of V along an axis where no maplet states it, metres.
    """

    def __init__(
        self, workspace: Workspace, folder: Path, options: TilingOptions, usual_sigma: float
    ) -> None:
        taken = {*workspace.maplet_names(), *workspace.landmark_names()}
        self._names = free_names(options.letters or free_letters(taken), taken)
        self._folder = folder
        self._options = options
        self._usual_sigma = usual_sigma
        self.tiles: list[Tile] = []

    def add(self, seed: Seed, pictures: tuple[ImagePoint, ...]) -> None:
        """Write a maplet; raises SettingsError if there is no more name, or WorkspaceError."""
        name, maplet = next(self._names), seed.maplet
        given = self._options.sigma_m
        stated = given is None and bool(np.isfinite(maplet.center_sigma).all())
        sigma = maplet.center_sigma if stated else np.full(3, given or self._usual_sigma)
        write_maplet(
            self._folder / "MAPFILES" / f"{name}.MAP",
            maplet.with_layers(name=name, center_sigma=sigma),
            sigma_companion=bool(np.isfinite(maplet.sigma).any()),
        )
        shares = (seed.from_maplets, seed.from_shape)
        self.tiles.append(Tile(name, maplet.grid, sigma, stated, pictures, seed.sources, shares))


@dataclass(frozen=True, eq=False)
class Lists:
    """Writes what names the new maplets into a new solution.

    Parameters
    ----------
    workspace : Workspace
        Of the parent.
    folder : Path
        Of the new solution.
    grids : mapping of str to MapletGrid
        Of the coarser maplets.
    replaced : Replaced
    """

    workspace: Workspace
    folder: Path
    grids: Mapping[str, MapletGrid]
    replaced: Replaced = field(default_factory=Replaced)

    def write(self, tiles: Sequence[Tile]) -> None:
        """Write landmarks and lists, and states without landmarks that are replaced."""
        new = [tile.name for tile in tiles]
        neighbours = overlaps_of({tile.name: tile.grid for tile in tiles})
        for tile, near in zip(tiles, neighbours, strict=True):
            kept = [name for name in tile.seed if name not in self.replaced.names]
            coarser = tuple(map_overlap(name, tile.grid, self.grids[name]) for name in kept)
            landmark = Landmark(
                tile.name,
                tile.grid,
                sigma=tile.sigma,
                prior_sigma=float(tile.sigma.max()),
                pictures=tile.pictures,
                overlaps=near + coarser,
            )
            write_landmark(self.folder / "LMKFILES" / f"{tile.name}.LMK", landmark)
        for listing, names in (
            ("MAPLIST.TXT", self.workspace.maplet_names()),
            ("LMRKLIST.TXT", self.workspace.landmark_names()),
        ):
            kept = [name for name in names if name not in self.replaced.names]
            write_list(self.folder / listing, [*kept, *new], kind="landmark")
        if self.replaced.names:
            self._write_states()

    def _write_states(self) -> None:
        """Write the states of images that name replaced landmarks, without these."""
        for image in self.workspace.images():
            kept = tuple(one for one in image.landmarks if one.name not in self.replaced.names)
            if len(kept) < len(image.landmarks):
                path = self.workspace.image_path(image.name)
                target = self.folder / "SUMFILES" / path.name
                write_summary(target, replace(image, landmarks=kept), like=path)
