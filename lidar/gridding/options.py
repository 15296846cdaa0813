"""Settings of the gridding of returns."""

from __future__ import annotations

from dataclasses import dataclass, field

from lidar.gridding.rejection import RejectionOptions
from lidar.scans.cubes import Box
from spcola.errors import SettingsError
from spcola.grids import MapletGrid


@dataclass(frozen=True)
class GriddingOptions:
    """Settings of the gridding of returns.

    Parameters
    ----------
    tolerance : float
        The iteration ends when no height changes by more than this, in GSD.
    max_iterations : int
        Most rounds of slopes and medians (for each set of accepted returns).
    baseline : float
        Least scatter of the cells' places (standard deviation, grid steps) along a direction in
        which a slope is fitted; below it a wider window is used.
    max_window : int
        Largest half-width, in cells, of the window in which slopes are fitted.
    reach_m : float, optional
        Returns further than this from the grid's plane belong to another part of the body and
        are ignored, metres; by default half the grid's width.
    default_sigma_m : float
        Standard deviation of a single return where neither the returns nor their spread in the
        neighbourhood determine it, metres.
    rejection : RejectionOptions
        Criteria for outliers.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    tolerance: float = 1e-4
    max_iterations: int = 50
    baseline: float = 0.3
    max_window: int = 3
    reach_m: float | None = None
    default_sigma_m: float = 0.1
    rejection: RejectionOptions = field(default_factory=RejectionOptions)

    def __post_init__(self) -> None:
        for name in ("tolerance", "max_iterations", "baseline", "max_window", "default_sigma_m"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"must be positive, not {getattr(self, name)}", name)
        if self.reach_m is not None and not self.reach_m > 0:
            raise SettingsError(f"must be positive, not {self.reach_m}", "reach_m")

    def reach(self, grid: MapletGrid) -> float:
        """Return the largest distance from the plane of `grid` that is used, metres."""
        return self.reach_m or grid.half_size * grid.gsd

    def box(self, grid: MapletGrid) -> Box:
        """Return the box that contains all returns which can fall on `grid`."""
        return Box.over(grid, self.reach(grid))
