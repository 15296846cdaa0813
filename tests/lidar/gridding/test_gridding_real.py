"""Real point clouds and shapes, gridded."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from lidar.formats.reader import read_scan
from lidar.gridding import GriddingOptions, grid_returns
from lidar.gridding.cells import sort_into_cells
from lidar.gridding.rejection import RejectionOptions
from lidar.scans import Returns
from spcola.formats.maplets import read_map
from spcola.formats.shapes import read_obj_mesh
from spcola.grids import MapletGrid
from spcola.shape import RayCaster, shape_heights

pytestmark = pytest.mark.real_data

REACH = 200.0


def test_autzen_is_gridded_exactly_as_by_brute_force(shared_data):
    """110 000 airborne returns on a map; metres are made feet again, hundredths of which add up."""
    metres = read_scan(shared_data / "pointcloud" / "autzen_trim.laz").points
    points = np.round(metres / 0.3048, 2)
    low, high = points.min(axis=0), points.max(axis=0)
    center = np.round([*(low + high)[:2] / 2, 0.0])
    grid = MapletGrid(center, np.eye(3), 25.0, 30)
    cells = sort_into_cells(grid, points, np.inf)
    assert len(cells.index) > 80_000

    column = np.rint((points[:, 0] - center[0]) / 25.0).astype(int) + 30
    row = np.rint((points[:, 1] - center[1]) / 25.0).astype(int) + 30
    count = np.zeros(grid.shape, dtype=int)
    mean, median = np.full(grid.shape, np.nan), np.full(grid.shape, np.nan)
    for m in range(61):
        for n in range(61):
            z = points[(row == m) & (column == n), 2]
            count[m, n] = len(z)
            if len(z):
                # Hundredths of a foot add up exactly.
                mean[m, n] = int(np.rint(100 * z).sum()) / len(z) / 100
                median[m, n] = np.median(z)
    assert np.array_equal(cells.count, count)
    assert np.array_equal(cells.medians(cells.height), median, equal_nan=True)
    assert np.nanmax(np.abs(cells.means(cells.height) - mean)) < 1e-12


@pytest.fixture(scope="module")
def bennu(shared_data):
    """The shape as a ray caster, OLA001.MAP of it, its height quantum, the shape's heights."""
    folder = shared_data / "bennu"
    caster = RayCaster(read_obj_mesh(folder / "g_12570mm_alt_obj_0000n00000_v014.obj"))
    file = read_map(folder / "OLA001.MAP")
    grid = file.maplet.grid
    shape = shape_heights(caster, grid, reach=REACH)
    return caster, file.maplet, file.header.hscale * grid.gsd, shape


def sampled(caster, grid, offsets):
    """Points of the shape above the places `offsets` (K, 2), grid steps, of each cell."""
    n, m = np.meshgrid(grid.offsets, grid.offsets)
    x = (n[..., None] + offsets[:, 0]).ravel()
    y = (m[..., None] + offsets[:, 1]).ravel()
    plane = grid.gsd * (x[:, None] * grid.ux + y[:, None] * grid.uy)
    above = grid.center + plane + REACH * grid.uz
    hits = caster.cast(above, np.broadcast_to(-grid.uz, above.shape))
    return hits.points, hits.facet


def gridded(grid, points):
    returns = Returns(
        points, np.full(len(points), 1e-3), np.zeros(len(points), dtype=int), ("shape",)
    )
    options = GriddingOptions(reach_m=REACH, tolerance=1e-10, rejection=RejectionOptions.none())
    result = grid_returns("OLA001", grid, returns, options=options)
    assert result.report.converged
    return result.mapola


def bend_around(mesh, grid, points, facet):
    """Ranges of ∂h/∂x and ∂h/∂y over the 3 × 3 cells around each grid point, added, × GSD."""
    cells = sort_into_cells(grid, points, REACH)
    normal = mesh.normals[facet[cells.index]]
    total = np.zeros(grid.shape)
    for axis in (grid.ux, grid.uy):
        slope = -(normal @ axis) / (normal @ grid.uz)
        low = np.minimum.reduceat(slope, cells.start[:-1]).reshape(grid.shape)
        high = np.maximum.reduceat(slope, cells.start[:-1]).reshape(grid.shape)
        total += maximum_filter(high, 3) - minimum_filter(low, 3)
    return total * grid.gsd


def test_ola001_lies_within_the_quantum_of_the_shape(bennu):
    _, maplet, quantum, shape = bennu
    assert np.count_nonzero(~maplet.valid) == 40
    # Half a count is what rounding to counts costs; 0.03 the single precision of the frame.
    assert np.nanmax(np.abs(maplet.height - shape)) < 0.53 * quantum


def test_returns_close_to_the_grid_points_give_ola001_within_the_quantum(bennu):
    """Footprints of a thousandth of a cell: what is left is the counts' rounding."""
    caster, maplet, quantum, shape = bennu
    offsets = np.random.default_rng(2).uniform(-1e-3, 1e-3, (9, 2))
    points, _ = sampled(caster, maplet.grid, offsets)
    mapola = gridded(maplet.grid, points)
    assert np.abs(mapola.height - shape).max() < 0.3 * quantum
    assert np.nanmax(np.abs(mapola.height - maplet.height)) < 0.7 * quantum


def test_returns_all_over_the_shape_give_its_heights_but_for_bends_inside_cells(bennu):
    """Facets are some 12 m wide, cells 1 m, and medians are those of whole cells.

    Where the ground under 3 × 3 cells is one plane, the heights are those of the shape. Across
    an edge the median over a cell is not the height at its grid point: it errs by up to a tenth
    of the change of slope around it times the GSD.
    """
    caster, maplet, quantum, shape = bennu
    side = (np.arange(5) + 0.5) / 5 - 0.5
    offsets = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    points, facet = sampled(caster, maplet.grid, offsets)
    mapola = gridded(maplet.grid, points)
    error = np.abs(mapola.height - shape)
    bend = bend_around(caster.mesh, maplet.grid, points, facet)
    flat = bend < 1e-9
    assert 0.15 < np.mean(flat) < 0.25
    assert error[flat].max() < 0.02 * quantum
    assert np.nanmax(np.abs(mapola.height - maplet.height)[flat]) < 0.55 * quantum
    assert np.max(error[~flat] / bend[~flat]) < 0.105
    assert np.mean(error < quantum) > 0.82
