"""The adjustment of scans over a workspace: which overlaps are compared, and until when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.pipeline import StageContext
from fusion.workspace.settings import MapolaSettings
from lidar.adjustment import (
    AdjustmentOptions,
    OverlapEquations,
    ScanAdjustment,
    adjust_scans,
    ground_shares,
    overlap_equations,
    unadjusted,
)
from lidar.archive import ScanStore
from lidar.gridding import Gridding, GriddingOptions, grid_returns
from lidar.scans import Returns
from spcola.grids import MapletGrid

# The overlaps are linear in displacements of a hundredth of a cell, and a step leaves a tenth of
# itself: one that moves scans against each other by no more leaves less than overlaps tell.
_STILL = 0.003
_MAX_ROUNDS = 5
# Overlaps are compared on grids whose centres lie this many sides apart: ground that is compared
# twice tells nothing new.
_APART = 1.0


@dataclass(frozen=True, eq=False)
class ScanSource:
    """The returns of all scans, and how they are gridded."""

    store: ScanStore
    options: GriddingOptions

    def gridded(
        self, name: str, grid: MapletGrid, adjustment: ScanAdjustment | None
    ) -> tuple[Gridding, Returns]:
        """Grid what lies around `grid`, moved by the adjustment; return it with the returns."""
        box = self.options.box(grid)
        if adjustment is None:
            around = self.store.returns_inside(box)
        else:
            wide = box.grown(adjustment.reach(box.center, box.radius))
            around = adjustment.corrected(self.store.returns_inside(wide))
        return grid_returns(name, grid, around, options=self.options), around


def adjusted(
    context: StageContext, source: ScanSource, grids: dict[str, MapletGrid]
) -> ScanAdjustment:
    """Find where the scans of a workspace lie to each other, in rounds until they stand still."""
    table = context.table(MapolaSettings)
    options = AdjustmentOptions(table.adjust_sigma_m, float(np.radians(table.adjust_sigma_deg)))
    found = unadjusted(source.store.scan_names, source.store.nodes, options)
    chosen = compared_grids(list(grids.values()))
    for _ in range(_MAX_ROUNDS):
        compare = _Comparison(source, chosen, found)
        parts = context.map("compare scans", compare.equations, range(len(chosen)))
        found = adjust_scans(found, [part for part in parts if part is not None], options=options)
        if found.step_m <= _STILL * min(grid.gsd for grid in chosen):
            break
    return found


def adjustment_summary(adjustment: ScanAdjustment) -> dict[str, Any]:
    """Return what the command prints of it."""
    known = adjustment.misfit[np.isfinite(adjustment.misfit)]
    return {
        "scans_that_overlap": int(np.count_nonzero(adjustment.cells)),
        "scan_up_sigma_m": adjustment.sizes.up_m,
        "scan_across_sigma_m": adjustment.sizes.across_m,
        "scan_rotation_sigma_deg": float(np.degrees(adjustment.sizes.rotation_rad)),
        "scan_wander_sigma_m": adjustment.sizes.wander_m,
        "day_up_sigma_m": adjustment.sizes.day_m,
        "scan_misfit": float(np.median(known)) if known.size else float("nan"),
        "suspect_scans": list(adjustment.suspects),
        "per_scan": [
            {
                "scan": name,
                "offset_m": adjustment.displacement[k, :3].tolist(),
                "rotation_deg": np.degrees(adjustment.displacement[k, 3:]).tolist(),
                "misfit": float(adjustment.misfit[k]),
                "cells": int(adjustment.cells[k]),
            }
            for k, name in enumerate(adjustment.names)
        ],
    }


@dataclass(frozen=True, eq=False)
class _Comparison:
    """One round: what the overlaps on each of the chosen grids say."""

    source: ScanSource
    grids: list[MapletGrid]
    before: ScanAdjustment

    def equations(self, number: int) -> OverlapEquations | None:
        grid = self.grids[number]
        gridding, returns = self.source.gridded("overlap", grid, self.before)
        near = [
            other
            for k, other in enumerate(self.grids)
            if k != number
            and float(np.linalg.norm(other.center - grid.center)) < other.radius + grid.radius
            and float(other.uz @ grid.uz) > 0.0
        ]
        share = ground_shares(grid, near, gridding.mapola.height)
        return overlap_equations(gridding, returns, self.before.center, share=share)


def compared_grids(grids: list[MapletGrid]) -> list[MapletGrid]:
    """Choose grids, in their order, that lie no nearer to each other than a side."""
    chosen: list[MapletGrid] = []
    centers = np.empty((0, 3))
    for grid in grids:
        side = 2.0 * grid.half_size * grid.gsd
        if len(centers) == 0 or np.linalg.norm(centers - grid.center, axis=1).min() > _APART * side:
            chosen.append(grid)
            centers = np.vstack([centers, grid.center])
    return chosen
