"""The returns of a workspace, geolocated by its settings and adjusted, around or on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.pipeline import StageContext
from fusion.scene.geolocation.locating import located_store
from fusion.workspace import Workspace
from fusion.workspace.settings.inputs import SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import MapolaSettings
from lidar.adjustment import ScanAdjustment
from lidar.formats.native import scan_summary
from lidar.gridding import Gridding, GriddingOptions, grid_returns
from lidar.gridding.rejection import RejectionOptions
from lidar.scan_store import ScanStore
from lidar.scans import Arcs, Returns
from spcola.grids import MapletGrid

# The covariance of the arcs' displacements is a full matrix, 37 MB for so many.
_MOST_ARCS = 360


@dataclass(frozen=True, eq=False)
class ReturnSource:
    """The returns of all scans, and the options of their gridding.

    Parameters
    ----------
    store : ScanStore
    options : GriddingOptions
    adjustment : ScanAdjustment, optional
        Displacements of the scans; those of the store are without them.
    """

    store: ScanStore
    options: GriddingOptions
    adjustment: ScanAdjustment | None = None

    @classmethod
    def of(cls, context: StageContext, adjustment: ScanAdjustment | None = None) -> ReturnSource:
        """Open the returns of a `context`, geolocated as for mapolas, with an `adjustment`."""
        tables = context.table(MapolaSettings), context.table(SpinSettings)
        return cls._opened(context.workspace, *tables, context.table(SpiceSettings), adjustment)

    @classmethod
    def of_workspace(cls, workspace: Workspace) -> ReturnSource:
        """Open the returns of a workspace as its mapolas were made of them."""
        settings = workspace.settings()
        tables = settings.mapolas, settings.spin, settings.spice
        return cls._opened(workspace, *tables, workspace.adjustment())

    @classmethod
    def _opened(
        cls,
        workspace: Workspace,
        table: MapolaSettings,
        spin: SpinSettings,
        spice: SpiceSettings,
        adjustment: ScanAdjustment | None,
    ) -> ReturnSource:
        arc_s = arc_length(workspace, table) if table.adjust else np.inf
        store = located_store(workspace, table, spin, spice, arc_s=arc_s)
        return cls(store, gridding_options(table), adjustment)

    def around(self, grid: MapletGrid, margin: float = 0.0) -> Returns:
        """Return the returns on `grid` or, along its plane, within `margin` metres of it."""
        box = self.options.box(grid)
        box = box.grown(margin) if margin else box
        if self.adjustment is None:
            return self.store.returns_inside(box)
        wide = box.grown(self.adjustment.reach(box.center, box.radius))
        return self.adjustment.corrected(self.store.returns_inside(wide))

    def gridded(self, name: str, grid: MapletGrid) -> tuple[Gridding, Returns]:
        """Grid the returns around `grid` as the mapola `name`; return the result with them."""
        around = self.around(grid)
        return grid_returns(name, grid, around, options=self.options), around


def gridding_options(table: MapolaSettings) -> GriddingOptions:
    """Return the options of gridding from the settings in `table`."""
    return GriddingOptions(rejection=RejectionOptions(cell_sigmas=table.outlier_k))


def arc_length(workspace: Workspace, table: MapolaSettings) -> float:
    """Return the length of arcs, seconds: longer than in the settings if they were too many."""
    spans = [scan_summary(path).time_span for path in workspace.scan_paths()]
    arc_s = table.adjust_arc_s
    while sum(Arcs.of_span(span, arc_s).count for span in spans) > max(_MOST_ARCS, len(spans)):
        arc_s *= 1.2
    return arc_s
