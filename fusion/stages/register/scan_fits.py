"""Each scan registered by itself: how single scans lie to SPC, or why that cannot be told."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.pipeline import StageContext
from fusion.registration.fit import (
    Model,
    Registration,
    about_origin,
    natural_sizes,
    similarity_numbers,
    transform_partials,
    updated_transform,
)
from fusion.registration.returns import (
    CloudOfReturns,
    Equations,
    FixedSurface,
    SurfaceSays,
    modelled_covariance,
    surface_equations,
)
from fusion.stages.mapolas.adjusting import compared_grids
from fusion.stages.register.return_source import ReturnSource
from fusion.surfacematch import Surface
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid
from spcola.math import Affine, Similarity

# A scan with fewer returns on a surface tells nothing there.
_FEWEST = 200
# Each begins where the mission as a whole lies, centimetres away.
_PASSES = 2


@dataclass(frozen=True, eq=False)
class ScanFit:
    """The transform of one scan.

    Attributes
    ----------
    transform : Affine
        Lidar, as adjusted, to SPC coordinates; where it began if it cannot be told.
    model : str
    covariance : (P, P) ndarray
        About the origin; the errors of maplets' centres are in it.
    center : (3,) ndarray
        The scan's own middle, lidar coordinates, metres.
    surfaces, points : int
        Maplets that it crosses and its returns there.
    reason : str
        Why it cannot be told; empty if it can.
    """

    transform: Affine
    model: Model
    covariance: FloatArray
    center: FloatArray
    surfaces: int = 0
    points: int = 0
    reason: str = ""

    @property
    def similarity(self) -> Similarity:
        """The transform as a similarity."""
        return self.transform.nearest_similarity()

    def stepped(
        self, parts: list[SurfaceSays], names: tuple[str, ...], maplet_sigma_m: float
    ) -> ScanFit:
        """Return the fit after one Gauss–Newton step by what the surfaces say.

        `maplet_sigma_m` is the error of a maplet's centre, each axis.
        """
        surfaces, points = len(parts), sum(part.returns for part in parts)
        if not surfaces:
            reason = f"no maplet is covered by {_FEWEST} of its returns"
            return self._without(surfaces, points, reason)
        equations = [part.equations for part in parts]
        joined = Equations.joined(equations)
        try:
            step = joined.solve(names, natural_sizes(names, _extent(joined)))
        except NotObservableError as error:
            return self._without(surfaces, points, error.what)
        covariance = modelled_covariance(equations, [part.area for part in parts], maplet_sigma_m)
        return ScanFit(
            updated_transform(self.transform, step, self.model, self.center),
            self.model,
            about_origin(covariance, self.model, self.transform, self.center),
            self.center,
            surfaces,
            points,
        )

    def _without(self, surfaces: int, points: int, reason: str) -> ScanFit:
        return ScanFit(
            self.transform, self.model, self.covariance, self.center, surfaces, points, reason
        )

    def entry(self, name: str, whole: Registration) -> dict[str, Any]:
        """Return what ``registration.json`` says of it.

        ``offset_m`` is where it puts its middle against where `whole` puts it.
        """
        entry: dict[str, Any] = {
            "scan": name,
            "maplets": self.surfaces,
            "returns": self.points,
            "reason": self.reason,
        }
        if self.reason:
            return entry
        scale, scale_sigma, rotation, rotation_sigma = similarity_numbers(self)
        row = transform_partials(self.model, self.similarity, self.center[None], np.zeros(3))[0]
        return entry | {
            "offset_m": self.transform.apply(self.center) - whole.transform.apply(self.center),
            "offset_sigma_m": np.sqrt(np.diag(row @ self.covariance @ row.T)),
            "translation_m": self.transform.translation,
            "translation_sigma_m": np.sqrt(np.diag(self.covariance))[:3],
            "rotation_deg": np.degrees(rotation),
            "rotation_sigma_deg": np.degrees(rotation_sigma),
            "scale": scale,
            "scale_sigma": scale_sigma,
            "covariance": self.covariance,
        }


def _extent(equations: Equations) -> float:
    """Distance, metres, at which turns move the ground as much as the equations feel of them."""
    shown = np.diag(equations.shown)
    return float(np.sqrt(max(shown[3:].mean() / max(shown[:3].mean(), 1e-300), 1.0)))


@dataclass(frozen=True, eq=False)
class ScanRegistration:
    """Registers all scans at once, surface by surface: no more than one's returns are in memory.

    Parameters
    ----------
    source : ReturnSource
    reference : callable
        The SPC surface on a grid, for the mapola of a name.
    whole : Registration
        Of the mission: where each scan begins.
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

        Ground that two maplets share would count twice: maplets are taken that lie a side apart.
        """
        names, model = self.whole.parameters, self.whole.model
        apart = {id(grid) for grid in compared_grids(list(grids.values()))}
        chosen = [(name, grid) for name, grid in grids.items() if id(grid) in apart]
        store = self.source.store
        unknown = np.full((len(names),) * 2, np.inf)
        fits = {
            name: ScanFit(self.whole.transform, model, unknown, center)
            for name, center in zip(store.scan_names, store.nodes.center, strict=True)
        }
        maplet_sigma = self.whole.fit.sizes.independent
        for number in range(_PASSES):
            step = _Pass(self, fits)
            title = f"register scans, pass {number + 1} of {_PASSES}"
            parts = context.map(title, step.on_surface, chosen)
            fits = {
                name: fit.stepped(
                    [part[name] for part in parts if name in part], names, maplet_sigma
                )
                for name, fit in fits.items()
            }
        return [fit.entry(name, self.whole) for name, fit in fits.items()]


@dataclass(frozen=True, eq=False)
class _Pass:
    """What is asked of each surface in one pass."""

    of: ScanRegistration
    fits: Mapping[str, ScanFit]

    def on_surface(self, item: tuple[str, MapletGrid]) -> dict[str, SurfaceSays]:
        """What one surface says about each scan that crosses it."""
        name, grid = item
        fixed = FixedSurface(grid, self.of.reference(name, grid), self.of.blur_cells)
        around = self.of.source.around(grid, 0.0)
        counts = np.bincount(around.scan, minlength=len(around.scan_names))
        found: dict[str, SurfaceSays] = {}
        for scan in np.flatnonzero(counts >= _FEWEST).tolist():
            fit, chosen = self.fits[around.scan_names[scan]], around.scan == scan
            says = surface_equations(
                CloudOfReturns(around.points[chosen], around.sigma[chosen]),
                fixed,
                fit.transform,
                fit.center,
                size=len(fit.covariance),
                min_coverage=0.0,
            )
            if says is not None:
                found[around.scan_names[scan]] = says
        return found
