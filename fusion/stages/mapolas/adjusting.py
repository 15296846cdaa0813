"""The adjustment of scans of a workspace: choice of overlaps, and iteration to convergence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.pipeline import StageContext
from fusion.scene.geolocation import ReturnSource
from fusion.workspace.settings.processing import MapolaSettings
from lidar.adjustment import (
    AdjustmentOptions,
    OverlapEquations,
    ScanAdjustment,
    adjust_scans,
    overlap_equations,
)
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid

# Step, in cells, below which the adjustment has converged: overlaps are linear for displacements
# of a hundredth of a cell, and a step leaves a tenth of itself.
_CONVERGED_CELLS = 0.003
_MAX_ROUNDS = 5
# Overlaps are compared on grids whose centres lie this many sides apart: comparing the same
# surface twice adds nothing.
_APART = 1.0


def adjusted(
    context: StageContext, source: ReturnSource, grids: dict[str, MapletGrid]
) -> ScanAdjustment:
    """Estimate the displacements of scans against each other, iterated until they converge."""
    table = context.table(MapolaSettings)
    options = AdjustmentOptions(table.adjust_sigma_m, float(np.radians(table.adjust_sigma_deg)))
    found = ScanAdjustment.unadjusted(source.store.scan_names, source.store.arcs, options)
    chosen = compared_grids(list(grids.values()))
    for _ in range(_MAX_ROUNDS):
        compare = _Comparison(replace(source, adjustment=found), chosen, found.center)
        parts = context.map("compare scans", compare.equations, range(len(chosen)))
        found = adjust_scans(found, [part for part in parts if part is not None], options=options)
        if found.step_m <= _CONVERGED_CELLS * min(grid.gsd for grid in chosen):
            break
    return found


def adjustment_summary(adjustment: ScanAdjustment) -> dict[str, Any]:
    """Return the adjustment as the command prints it."""
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
    """One iteration: normal equations of the overlaps on each of the chosen grids."""

    source: ReturnSource
    grids: list[MapletGrid]
    center: FloatArray

    def equations(self, number: int) -> OverlapEquations | None:
        grid = self.grids[number]
        gridding, returns = self.source.gridded("overlap", grid)
        near = [
            other
            for k, other in enumerate(self.grids)
            if k != number
            and float(np.linalg.norm(other.center - grid.center)) < other.radius + grid.radius
            and float(other.uz @ grid.uz) > 0.0
        ]
        return overlap_equations(gridding, returns, self.center, others=near)


def compared_grids(grids: list[MapletGrid]) -> list[MapletGrid]:
    """Return grids, in their order, whose centres are at least a side apart."""
    chosen: list[MapletGrid] = []
    centers = np.empty((0, 3))
    for grid in grids:
        side = 2.0 * grid.half_size * grid.gsd
        if len(centers) == 0 or np.linalg.norm(centers - grid.center, axis=1).min() > _APART * side:
            chosen.append(grid)
            centers = np.vstack([centers, grid.center])
    return chosen
