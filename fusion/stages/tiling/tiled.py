"""A solution with new maplets over the body or a region: ``spcola spc tile``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fusion.pipeline.solutions import MadeBy, making_solution, new_name, solutions_of
from fusion.runtime import Executor, Progress, json_value
from fusion.runtime.machine import check_memory
from fusion.stages.lithos.options import light_of
from fusion.stages.solution_result import use_line
from fusion.stages.tiling.naming import MOST_NAMES
from fusion.stages.tiling.options import TilingOptions
from fusion.stages.tiling.sources import Sources, sources_of
from fusion.stages.tiling.writing import Lists, NewMaplets, Tile, replaced_maplets
from fusion.workspace import Workspace
from spcola.camera import ImagePoint
from spcola.errors import InvalidValueError, SettingsError, WorkspaceError
from spcola.formats.maplets import map_length
from spcola.grids import MapletGrid
from spcola.imagematching import ChoiceOptions, Pictures
from spcola.shape.tiling import Ground, Seed, seeded

# Samples of the surface for one maplet, and what each takes.
_SAMPLES, _SAMPLE_BYTES = 1500, 250
# Most passes over what earlier ones left uncovered.
_FURTHER = 4
# Share of the ground that a pass has to add for a next one to be tried.
_WORTH = 1e-3
# Least ground that a maplet of these passes adds, as a share of its square.
_LEAST = 0.01
# A .LMK with some thirty pictures and a dozen overlaps.
_LANDMARK_BYTES = 2500


@dataclass(frozen=True)
class TilingResult:
    """A new solution with more maplets.

    Attributes
    ----------
    solution, parent : str
    folder : Path
    gsd_m : float
    half_size : int
    maplets : int
        New ones.
    first, last : str
        Their names.
    passes : sequence of int
        New maplets of each pass.
    replaced : int
        Coarser maplets that the solution has no longer.
    covered : float
        Share of the ground over which new maplets have heights, 0 … 1.
    from_maplets, from_shape : float
        Shares of all points of the new maplets.
    sigma_m : float
        Median sigma of V along an axis.
    stated_sigma : int
        New maplets whose sigma comes from the maplets that seeded them.
    pictures : float
        Mean number of images of a new maplet.
    without_pictures : int
        New maplets that no image shows.
    """

    solution: str
    parent: str
    folder: Path
    gsd_m: float
    half_size: int
    maplets: int
    first: str
    last: str
    passes: Sequence[int]
    replaced: int
    covered: float
    from_maplets: float
    from_shape: float
    sigma_m: float
    stated_sigma: int
    pictures: float
    without_pictures: int

    def as_dict(self) -> dict[str, Any]:
        """Return the content in JSON types."""
        content: dict[str, Any] = json_value(asdict(self))
        return content

    def lines(self) -> list[str]:
        """Return the lines to print."""
        further = sum(self.passes[1:])
        second = f" ({further} in the second pass)" if further else ""
        unknown = 1.0 - self.from_maplets - self.from_shape
        stated = f"that of maplets for {self.stated_sigma}" if self.stated_sigma else "not stated"
        lines = [
            f"solution {self.solution}, from {self.parent}: {self.maplets} new maplets{second}, "
            f"{self.first} to {self.last}",
            # Downward: 100 % means that nothing is left.
            f"  GSD {self.gsd_m:g} m, half-size {self.half_size}: "
            f"{math.floor(1e4 * self.covered) / 100:g} % of the ground covered",
            f"  heights: {self.from_maplets:.1%} from maplets, {self.from_shape:.1%} from the "
            f"shape, {unknown:.1%} unknown",
            f"  sigma of the centres: {self.sigma_m:.3g} m (median; {stated})",
            f"  images: {self.pictures:.1f} of a maplet; {self.without_pictures} have none",
        ]
        if self.replaced:
            lines.append(f"  replaced: {self.replaced} coarser maplets")
        return [*lines, use_line(self.folder)]


@dataclass(frozen=True, eq=False)
class _Work:
    """Makes new maplets, one by one."""

    sources: Sources
    pictures: Pictures

    def maplet(
        self, grid: MapletGrid, *, nearest: bool = False
    ) -> tuple[Seed, tuple[ImagePoint, ...]]:
        """Return a maplet on a grid, still without a name, and the images that show it."""
        around, caster = self.sources.maplets.around(grid), self.sources.caster
        seed = seeded("new", grid, around, caster, nearest=nearest)
        return seed, self.pictures.of(seed.maplet.grid)


def tile_solution(
    workspace: Workspace,
    name: str,
    options: TilingOptions,
    executor: Executor,
    progress: Progress,
    *,
    job: str = "",
) -> TilingResult:
    """Make a solution with new maplets: that of the workspace stays as it is.

    Maplets are spread evenly so that neighbours overlap, and get first heights and albedo from
    coarser ones by projection, else from the shape. Ground that they do not cover, such as below
    overhangs, gets further ones. The new solution is made whole or not at all.

    Parameters
    ----------
    workspace : Workspace
    name : str
        Of the new solution; empty: ``tiled-1``, ``tiled-2``, …
    options : TilingOptions
    executor : Executor
    progress : Progress
    job : str, optional
        What asks for it, as the solution's record has it: the same one again gets the solution
        that it made before.

    Raises
    ------
    SettingsError
        If the GSD does not fit the body or what the maplets are seeded from, or there would be
        more maplets than names.
    WorkspaceError
        If there is nothing to seed from, a solution of that name is there, or something cannot
        be read or written.
    InvalidValueError
        If the region has no surface.
    """
    if (made := solutions_of(workspace).of_job(job)) is not None:
        return TilingResult(
            made.name, made.parent, _home(workspace, made.name), **made.facts["made"]
        )
    chosen = new_name(workspace, name, "tiled")
    sources, ground = _planned(workspace, options, progress)
    replaced = replaced_maplets(sources.maplets.grids, options)
    facts: dict[str, Any] = {"tiling": options.as_json(), **({"job": job} if job else {})}
    made_by = MadeBy("spcola spc tile", {}, facts, {})
    with making_solution(workspace, chosen, made_by, without=replaced.files) as folder:
        usual = max(options.gsd_m, sources.shape_error)
        new = NewMaplets(workspace, folder, options, usual)
        work = _Work(sources, _pictures(workspace, sources, options))
        passes = _passes(new, ground, work, executor, progress)
        Lists(workspace, folder, sources.maplets.grids, replaced).write(new.tiles)
        facts["made"] = {
            "gsd_m": options.gsd_m, "half_size": options.half_size, "passes": passes,
            "replaced": len(replaced.names), "covered": ground.share, **_counts(new.tiles),
        }  # fmt: skip
    made_facts: Mapping[str, Any] = facts["made"]
    return TilingResult(chosen, workspace.solution, _home(workspace, chosen), **made_facts)


def forecast_tiling(
    workspace: Workspace, name: str, options: TilingOptions, progress: Progress
) -> dict[str, Any]:
    """Return how many maplets :func:`tile_solution` makes and what disk they take.

    Parameters
    ----------
    workspace : Workspace
    name : str
        As there: a name that is taken is refused.
    options : TilingOptions
    progress : Progress

    Returns
    -------
    dict
        ``maplets`` of the first pass, ``disk_mb``, ``gsd_m``, ``half_size``; nothing is written.
    """
    new_name(workspace, name, "tiled")
    _, ground = _planned(workspace, options, progress)
    with progress.task("spread maplets"):
        count = len(ground.grids())
    _check_count(count)
    each = map_length(options.half_size) + _LANDMARK_BYTES
    return {
        "maplets": count,
        "disk_mb": count * each / 1e6,
        "gsd_m": options.gsd_m,
        "half_size": options.half_size,
    }


def _home(workspace: Workspace, name: str) -> Path:
    return replace(workspace, solution=name).home


def _planned(
    workspace: Workspace, options: TilingOptions, progress: Progress
) -> tuple[Sources, Ground]:
    """Return what maplets are seeded from, and the ground that they are to cover."""
    sources = sources_of(workspace, options, progress)
    surface = sources.surface(options)
    circle = options.circle
    area = float(np.linalg.norm(surface.area_vectors, axis=1).sum())
    if circle is not None:
        area = min(area, np.pi * circle.radius**2)
    # The least number of maplets on a plane.
    side = 2.0 * options.gsd_m * options.half_size * (1.0 - options.overlap)
    _check_count(area / side**2)
    check_memory(
        _SAMPLES * _SAMPLE_BYTES * area / side**2,
        f"spreading {area / side**2:.3g} maplets",
        f"--gsd {options.gsd_m:g}",
        "tile the body in regions: --within LAT,LON,RADIUS_M",
    )
    with progress.task("sample the surface"):
        try:
            ground = Ground(
                surface, options.gsd_m, options.half_size, overlap=options.overlap, circle=circle
            )
        except InvalidValueError as error:
            if circle is None:
                raise
            raise InvalidValueError(
                "there is no surface in the region", "--within", "give another place or radius"
            ) from error
    return sources, ground


def _check_count(count: float) -> None:
    """Refuse more maplets than there are names."""
    if count > MOST_NAMES:
        raise SettingsError(
            f"gives at least {count:.3g} maplets; two letters have names for {MOST_NAMES}",
            "--gsd",
            "raise it, or tile a region: --within LAT,LON,RADIUS_M",
        )


def _pictures(workspace: Workspace, sources: Sources, options: TilingOptions) -> Pictures:
    """Return what finds the images of a maplet: as many as it may have, those that solve it."""
    choice = ChoiceOptions(most=options.max_images, light=light_of(workspace.settings()))
    return Pictures(workspace.images(), sources.caster, choice)


def _passes(
    new: NewMaplets, ground: Ground, work: _Work, executor: Executor, progress: Progress
) -> list[int]:
    """Make maplets over the ground, then over what is left of it; return how many each time.

    Raises
    ------
    WorkspaceError
        If none gets any height.
    """
    with progress.task("spread maplets"):
        grids = ground.grids()
    _check_count(len(grids))
    counts, gain = list[int](), 1.0
    while grids and len(counts) <= _FURTHER and gain > _WORTH:
        further, before, share = bool(counts), len(new.tiles), ground.share
        make = partial(work.maplet, nearest=further)
        with progress.task("make maplets", len(grids)) as task:
            for seed, pictures in executor.stream(make, grids):
                # Those of the first pass overlap as asked, whatever each one adds.
                if seed.maplet.valid.any() and ground.cover(seed.maplet, _LEAST * further):
                    new.add(seed, pictures)
                task.advance()
        counts.append(len(new.tiles) - before)
        gain = ground.share - share
        grids = ground.further_grids()
    if not new.tiles:
        raise WorkspaceError(
            "no new maplet gets any height: neither maplets nor a shape reach there",
            "--within",
            "give another place, or --from shape",
        )
    return [count for count in counts if count]


def _counts(tiles: Sequence[Tile]) -> dict[str, Any]:
    """Return numbers of the new maplets."""
    shares = np.mean([tile.shares for tile in tiles], axis=0)
    pictures = [len(tile.pictures) for tile in tiles]
    return {
        "maplets": len(tiles),
        "first": tiles[0].name,
        "last": tiles[-1].name,
        "from_maplets": float(shares[0]),
        "from_shape": float(shares[1]),
        "sigma_m": float(np.median([tile.sigma for tile in tiles])),
        "stated_sigma": sum(tile.stated for tile in tiles),
        "pictures": float(np.mean(pictures)),
        "without_pictures": pictures.count(0),
    }
