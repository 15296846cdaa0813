"""The returns of a workspace, as registration asks for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.pipeline import StageContext
from fusion.registration.returns import CloudOfReturns, FixedSurface, match_returns
from fusion.stages.geolocation.locating import located_store
from fusion.stages.mapolas.stage import arc_length, gridding_options
from fusion.surfacematch import Match, MatchOptions, Surface
from fusion.workspace.settings import MapolaSettings, SpiceSettings, SpinSettings
from lidar.adjustment import ScanAdjustment
from lidar.archive import ScanStore
from lidar.gridding import GriddingOptions
from lidar.scans import Returns
from spcola.grids import MapletGrid


@dataclass(frozen=True, eq=False)
class ReturnSource:
    """The returns of all scans, where they were when the mapolas were made of them."""

    store: ScanStore
    adjustment: ScanAdjustment | None
    options: GriddingOptions

    @classmethod
    def of(cls, context: StageContext) -> ReturnSource:
        """Open the returns of a workspace, located and adjusted as for its mapolas."""
        workspace, table = context.workspace, context.table(MapolaSettings)
        store = located_store(
            workspace,
            table,
            context.table(SpinSettings),
            context.table(SpiceSettings),
            arc_s=arc_length(workspace, table) if table.adjust else np.inf,
        )
        return cls(store, workspace.adjustment(), gridding_options(table))

    def around(self, grid: MapletGrid, margin: float) -> Returns:
        """Return the returns that lie on `grid` or, along its plane, within `margin` metres."""
        box = self.options.box(grid).grown(margin)
        if self.adjustment is None:
            return self.store.returns_inside(box)
        wide = box.grown(self.adjustment.reach(box.center, box.radius))
        return self.adjustment.corrected(self.store.returns_inside(wide))

    def match(
        self, name: str, grid: MapletGrid, fixed: Surface, blur: float, options: MatchOptions
    ) -> Match:
        """Match the returns about `grid` to the SPC surface there."""
        around = self.around(grid, options.capture_m)
        cloud = CloudOfReturns(around.points, around.sigma)
        return match_returns(name, cloud, FixedSurface(grid, fixed, blur), options=options)
