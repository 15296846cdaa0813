"""Iteration of slopes and medians: the surface of the returns on a grid.

The iteration is that of Gaskell et al., eq. 35 and 36: each return is projected into the grid's
frame and assigned to its nearest grid point; its height is moved to that point with the slope of
the current surface; the median of a cell is the new surface; and so on until nothing changes.
([35] is printed with Ux for the height; it is Uz.)

The slope of a cell is that of a plane through the 3 × 3 cells around it, fitted not at their
grid points but where their returns lie (see :mod:`lidar.gridding.cells.planes`). Compared with
differences of the gridded heights this averages noise over nine cells, tolerates gaps, and makes
the iteration converge quickly: a plane is recovered exactly from returns at any places.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lidar.gridding.cells.cells import CellReturns, CorrectedMedians
from lidar.gridding.cells.planes import PlaneFit
from lidar.gridding.cells.windows import PlaneWindows
from lidar.gridding.options import GriddingOptions
from spcola.arrays import FloatArray
from spcola.compilation import compiled

# Rounds before the iteration takes half steps.
_FULL_STEPS = 10
# A median is unchanged where new slopes would move it by less than this share of the tolerance.
_NEGLECTED = 0.05


@dataclass(frozen=True, eq=False)
class IteratedSurface:
    """The surface at the end of an iteration.

    Attributes
    ----------
    cells : CellReturns
        The returns of C = R² cells.
    medians : CorrectedMedians
    windows : PlaneWindows
    fitted : (R, R) ndarray
        Heights at the places of the cells to which the last planes were fitted, metres.
    height : (R, R) ndarray
        At the grid points, metres; NaN where empty.
    slope_x, slope_y : (R, R) ndarray
        Metres per grid step.
    corrected : (K,) ndarray
        Slope-corrected heights of the returns, metres.
    iterations : int
    change : float
        Largest change of a height in the last round, metres.
    converged : bool
    """

    cells: CellReturns
    medians: CorrectedMedians
    windows: PlaneWindows
    fitted: FloatArray
    height: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray
    corrected: FloatArray
    iterations: int
    change: float
    converged: bool

    @cached_property
    def planes(self) -> PlaneFit:
        """The planes of the last slopes."""
        return self.windows.fit(self.fitted)

    @cached_property
    def spread(self) -> FloatArray:
        """Robust standard deviation of the returns of each cell, metres; NaN if empty."""
        return self.cells.spreads(self.corrected, self.height)


def iterate_surface(
    cells: CellReturns,
    gsd: float,
    options: GriddingOptions,
    *,
    start: IteratedSurface | None = None,
) -> IteratedSurface:
    """Iterate slopes and medians until no height changes, from the slopes of `start`."""
    place_x, place_y = cells.place
    # Dense cells fit better, but beyond a few returns roughness, not noise, dominates departures
    # from the plane: the weight levels off.
    weight = cells.count / (cells.count + 1.0)
    before = None if start is None else start.medians
    medians = CorrectedMedians(cells, _NEGLECTED * options.tolerance * gsd, before)
    if start is None:
        height = at_place = cells.middle
        slope_x, slope_y = np.zeros_like(height), np.zeros_like(height)
    else:
        slope_x, slope_y = start.slope_x, start.slope_y
        height = medians.at(slope_x, slope_y)
        at_place = height + slope_x * place_x + slope_y * place_y
    windows = PlaneWindows(
        place_x, place_y, weight, baseline=options.baseline, max_radius=options.max_window
    )
    change, iteration = np.inf, 0
    while change > options.tolerance * gsd and iteration < options.max_iterations:
        fitted = at_place
        new_x, new_y = windows.slopes(fitted)
        if iteration >= _FULL_STEPS:
            # A median may alternate between two returns for ever; half steps end that.
            new_x, new_y = 0.5 * (slope_x + new_x), 0.5 * (slope_y + new_y)
        slope_x, slope_y = new_x, new_y
        previous, height = height, medians.at(slope_x, slope_y)
        at_place, change = _carried(height, previous, (slope_x, slope_y), (place_x, place_y))
        iteration += 1
    converged = change <= options.tolerance * gsd
    corrected = medians.of_returns(slope_x, slope_y)
    return IteratedSurface(
        cells,
        medians,
        windows,
        fitted,
        height,
        slope_x,
        slope_y,
        corrected,
        iteration,
        change,
        converged,
    )


@compiled
def _carried(
    height: FloatArray,
    previous: FloatArray,
    slopes: tuple[FloatArray, FloatArray],
    places: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, float]:
    """Heights (R, C) moved from the grid points to the places, and the largest change, metres."""
    at_place = np.empty_like(height)
    change = 0.0
    for row in range(height.shape[0]):
        for column in range(height.shape[1]):
            here = (row, column)
            carried = slopes[0][here] * places[0][here] + slopes[1][here] * places[1][here]
            at_place[here] = height[here] + carried
            moved = abs(height[here] - previous[here])
            change = moved if moved > change else change
    return at_place, change
