"""Registration of each scan of a workspace by itself to SPC."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.pipeline import StageContext
from fusion.registration.fit import Registration
from fusion.registration.returns import (
    CloudOfReturns,
    FixedSurface,
    ScanFit,
    SurfaceNormalEquations,
)
from fusion.scene.geolocation import ReturnSource
from fusion.stages.mapolas import compared_grids
from fusion.surfacematch import Surface
from spcola.grids import MapletGrid

# Each begins at the registration of the whole mission, centimetres away.
_PASSES = 2


@dataclass(frozen=True, eq=False)
class ScanRegistration:
    """Registers all scans at once, with the returns of one surface at a time in memory.

    Parameters
    ----------
    source : ReturnSource
    reference : callable
        The SPC surface on a grid, for the mapola of a name.
    whole : Registration
        Registration of the mission: the initial transform of each scan.
    blur_cells : float
        Blur of the SPC surface against the lidar, cells.
    """

    source: ReturnSource
    reference: Callable[[str, MapletGrid], Surface]
    whole: Registration
    blur_cells: float

    def entries(
        self, context: StageContext, grids: Mapping[str, MapletGrid]
    ) -> list[dict[str, Any]]:
        """Return an entry of ``registration.json`` for every scan.

        Maplets a side apart are used: the overlap of two maplets would count twice.
        """
        apart = {id(grid) for grid in compared_grids(list(grids.values()))}
        chosen = [(name, grid) for name, grid in grids.items() if id(grid) in apart]
        store = self.source.store
        unknown = np.full(self.whole.covariance.shape, np.inf)
        fits = {
            name: ScanFit(self.whole.model, self.whole.transform, unknown, center)
            for name, center in zip(store.scan_names, store.arcs.center, strict=True)
        }
        maplet_sigma = self.whole.fit.sizes.independent
        for number in range(_PASSES):
            step = _Pass(self, fits)
            title = f"register scans, pass {number + 1} of {_PASSES}"
            parts = context.map(title, step.on_surface, chosen)
            fits = {
                name: fit.stepped([part[name] for part in parts if name in part], maplet_sigma)
                for name, fit in fits.items()
            }
        return [fit.entry(name, self.whole.transform) for name, fit in fits.items()]


@dataclass(frozen=True, eq=False)
class _Pass:
    """One iteration over all surfaces."""

    of: ScanRegistration
    fits: Mapping[str, ScanFit]

    def on_surface(self, item: tuple[str, MapletGrid]) -> dict[str, SurfaceNormalEquations]:
        """Return the normal equations of one surface for each scan that crosses it."""
        name, grid = item
        fixed = FixedSurface(grid, self.of.reference(name, grid), self.of.blur_cells)
        around = self.of.source.around(grid)
        counts = np.bincount(around.scan, minlength=len(around.scan_names))
        found: dict[str, SurfaceNormalEquations] = {}
        for scan in np.flatnonzero(counts).tolist():
            fit, chosen = self.fits[around.scan_names[scan]], around.scan == scan
            returns = CloudOfReturns(around.points[chosen], around.sigma[chosen])
            equations = fit.equations(returns, fixed)
            if equations is not None:
                found[around.scan_names[scan]] = equations
        return found
