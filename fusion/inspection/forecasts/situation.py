"""What a workspace has at the moment, as far as forecasts depend on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fusion.inspection.forecasts.synthetic import SyntheticCosts
from fusion.inspection.forecasts.timing import NotingStore
from fusion.pipeline import Stage, StageContext
from fusion.pipeline.items import item_folder, whole_version
from fusion.runtime import Progress, ThreadExecutor
from fusion.stages.mapolas import mapola_grids
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.processing import MapolaSettings
from lidar.formats.native import scan_summary
from spcola.errors import WorkspaceError
from spcola.grids import MapletGrid

# Maplets that are read for their usual size.
_LOOKED_AT = 24
# Memory of a shape in bytes of its file.
_SHAPE_FACTOR = 80.0


@dataclass(frozen=True)
class Situation:
    """A workspace, its settings and this machine.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    workers : int
    ready : frozenset of str
        Names of stages that have all their inputs, so that items of their own can be timed.
    """

    workspace: Workspace
    settings: Settings
    workers: int
    ready: frozenset[str] = frozenset()

    @cached_property
    def grids(self) -> dict[str, MapletGrid]:
        """Grids of the mapolas that are to be made, by name."""
        return mapola_grids(self.workspace, self.settings)

    @cached_property
    def usual(self) -> MapletGrid:
        """Grid of median size of some maplets; of mapolas where there are no maplets.

        Raises
        ------
        WorkspaceError
            If there is neither.
        """
        names = self.workspace.maplet_names()
        chosen = names[:: max(1, -(-len(names) // _LOOKED_AT))]
        grids = [self.workspace.maplet(name).grid for name in chosen] or list(self.grids.values())
        if not grids:
            raise WorkspaceError("there are neither maplets nor a covering", self.workspace.root)
        return sorted(grids, key=lambda grid: grid.size)[len(grids) // 2]

    @cached_property
    def usual_mapola(self) -> MapletGrid:
        """The same of the mapolas."""
        table: MapolaSettings = self.settings.mapolas
        grid = self.usual.with_gsd(table.gsd_m) if table.gsd_m else self.usual
        return replace(grid, half_size=table.half_size) if table.half_size else grid

    @cached_property
    def synthetic(self) -> SyntheticCosts:
        """Costs of made-up items of the usual size."""
        grid = self.usual_mapola
        return SyntheticCosts(grid.half_size, grid.gsd, self.workers)

    @cached_property
    def returns(self) -> int:
        """Number of returns of all scans."""
        return sum(scan_summary(path).count for path in self.workspace.scan_paths())

    @cached_property
    def shape_bytes(self) -> float:
        """Memory of the shape and its ray caster, by the size of its file."""
        if not self.workspace.has_shape():
            return 0.0
        return _SHAPE_FACTOR * self.workspace.shape_path().stat().st_size

    @cached_property
    def radius(self) -> float:
        """Mean radius of the body, metres."""
        stated = self.settings.body.mean_radius_m
        if stated or not self.workspace.has_shape():
            return stated or float(np.linalg.norm(self.usual.center))
        return self.workspace.shape().mean_radius

    def store(self, stage: Stage) -> NotingStore:
        """Return where the stage keeps its items."""
        return NotingStore(
            item_folder(self.workspace.home, stage.name), whole_version(stage.version)
        )

    def context(self, stage: Stage, store: NotingStore, **changed: Any) -> StageContext:
        """Return a context in which parts of a stage can be tried."""
        return StageContext(
            self.workspace, self.settings, stage.tables, ThreadExecutor(self.workers), Progress(),
            {}, "", Path(), store, **changed,
        )  # fmt: skip
