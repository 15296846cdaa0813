"""First heights and albedo of a new maplet, from coarser maplets and a shape.

Coarser maplets are projected into the new frame (Gaskell et al., eqs. 24–27). What they do not
reach gets the slopes of the shape, as in section 4 there: its heights are bent to meet theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.bigmap import BigmapOptions, make_bigmap
from spcola.grids import Maplet, MapletGrid, project_window
from spcola.heights import HeightProblem, SolverOptions, solve_heights
from spcola.shape.rays import RayCaster
from spcola.shape.shape_grid import shape_heights

# Maplets whose GSD is within this factor of the finest are averaged with it.
_SAME_LEVEL = 1.5
# Weight of a known height against that of a step where heights of two sources meet.
_FIRM = 1e4


@dataclass(frozen=True, eq=False)
class Seed:
    """A new maplet, and where its heights come from.

    Parameters
    ----------
    maplet : Maplet
        Its centre lies on its surface, where that is known.
    sources : tuple of str
        Maplets that gave heights.
    from_maplets, from_shape : float
        Shares of the points with heights of maplets, and of the shape.
    """

    maplet: Maplet
    sources: tuple[str, ...]
    from_maplets: float
    from_shape: float


def seeded(
    name: str,
    grid: MapletGrid,
    maplets: Sequence[Maplet],
    caster: RayCaster | None,
    *,
    nearest: bool = False,
) -> Seed:
    """Return a new maplet with the heights of the finest maplets there, else of the shape.

    Maplets of about one GSD are averaged with the weights of a bigmap; coarser ones fill what
    finer ones do not reach, the shape what no maplet reaches. Each further source contributes its
    relief and is bent to meet the heights before it, so that no step remains. Points without any
    source stay NaN.

    Parameters
    ----------
    name : str
    grid : MapletGrid
        Its centre near the surface.
    maplets : sequence of Maplet
        Coarser ones around, in any order.
    caster : RayCaster or None
        Of the shape; None to leave it out.
    nearest : bool
        Whether, of several sheets of the shape, each point gets the one nearest to the plane, as
        below an overhang; else the outermost, unless the centre lies on another one.
    """
    height, albedo = np.full(grid.shape, np.nan), np.ones(grid.shape)
    sigma, sources = np.full(grid.shape, np.nan), list[Maplet]()
    # Only those that reach the grid count, so that sigmas and overlaps are theirs.
    reaching = [one for one in maplets if project_window(one, grid).valid.any()]
    for level in _levels(reaching):
        missing = np.isnan(height)
        if not missing.any():
            break
        options = BigmapOptions(integrate=len(level) > 1, max_distance=grid.radius)
        found = make_bigmap(name, grid, level, options=options)
        new = missing & found.valid
        if not new.any():
            continue
        stated = any(np.isfinite(one.sigma).any() for one in level)
        albedo = np.where(new & np.isfinite(found.albedo), found.albedo, albedo)
        sigma = np.where(new & stated, found.sigma, sigma)
        height = _joined(height, found.height)
        sources += level
    covered = np.isfinite(height)
    if caster is not None and not covered.all():
        height = _joined(height, _of_shape(caster, grid, nearest))
    maplet = Maplet(name, grid, height, albedo, sigma, _center_sigma(sources))
    named = tuple(one.name for one in sources)
    of_shape = float(np.mean(np.isfinite(height) & ~covered))
    return Seed(_centred(maplet), named, float(np.mean(covered)), of_shape)


def _levels(maplets: Sequence[Maplet]) -> list[list[Maplet]]:
    """Return maplets in groups of about one GSD, the finest first."""
    levels: list[list[Maplet]] = []
    for maplet in sorted(maplets, key=lambda one: (one.grid.gsd, one.name)):
        if levels and maplet.grid.gsd <= _SAME_LEVEL * levels[-1][0].grid.gsd:
            levels[-1].append(maplet)
        else:
            levels.append([maplet])
    return levels


def _of_shape(caster: RayCaster, grid: MapletGrid, nearest: bool) -> FloatArray:
    """Return the heights of the shape: of the sheet on which the centre of the grid lies."""
    if not nearest:
        height = shape_heights(caster, grid, reach=grid.radius)
        middle = height[grid.half_size, grid.half_size]
        # NaN compares as False: the centre lies below an overhang, or beyond the reach.
        if abs(middle) <= grid.gsd:
            return height
    return shape_heights(caster, grid, reach=grid.radius, surface="nearest")


def _joined(known: FloatArray, relief: FloatArray) -> FloatArray:
    """Return known heights, and elsewhere those that have the steps of a relief and meet them."""
    missing = np.isnan(known) & np.isfinite(relief)
    if not missing.any() or np.isnan(known).all():
        return np.where(missing, relief, known)
    step_x, step_y = np.diff(relief, axis=1), np.diff(relief, axis=0)
    problem = HeightProblem(
        np.nan_to_num(step_x),
        np.nan_to_num(step_y),
        np.isfinite(step_x).astype(np.float64),
        np.isfinite(step_y).astype(np.float64),
        known,
        np.where(np.isnan(known), 0.0, _FIRM),
        np.isfinite(known) | missing,
    )
    start = np.where(missing, relief, known)
    options = SolverOptions(tolerance_m=1e-6 * max(float(np.nanmax(np.abs(start))), 1e-3))
    solved = solve_heights(problem, options=options, start=start).height
    return np.where(missing, solved, known)


def _center_sigma(sources: Sequence[Maplet]) -> FloatArray:
    """Return the rms sigma (3,) of the centres of the sources that state it, metres; or NaN."""
    stated = [one.center_sigma for one in sources if (one.center_sigma > 0).all()]
    if not stated:
        return np.full(3, np.nan)
    rms: FloatArray = np.sqrt(np.mean(np.square(stated), axis=0))
    return rms


def _centred(maplet: Maplet) -> Maplet:
    """Return the same surface with V moved along Uz onto it, where it has a height."""
    grid = maplet.grid
    offset = float(maplet.height[grid.half_size, grid.half_size])
    if not np.isfinite(offset):
        return maplet
    moved = replace(grid, center=grid.center + offset * grid.uz)
    return replace(maplet, grid=moved, height=maplet.height - offset)
