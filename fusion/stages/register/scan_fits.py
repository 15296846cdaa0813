"""Registration of each scan by itself to SPC."""

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
    SurfaceNormalEquations,
    modelled_covariance,
    surface_equations,
)
from fusion.stages.geolocation.return_source import ReturnSource
from fusion.stages.mapolas.adjusting import compared_grids
from fusion.surfacematch import Surface
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid
from spcola.math import Affine, Similarity

# Surfaces with fewer returns of a scan are not used for it.
_FEWEST = 200
# Each begins at the registration of the whole mission, centimetres away.
_PASSES = 2


@dataclass(frozen=True, eq=False)
class ScanFit:
    """The transform of one scan.

    Attributes
    ----------
    transform : Affine
        From adjusted lidar to SPC coordinates; the initial one if it is not observable.
    model : str
    covariance : (P, P) ndarray
        About the origin; it includes the errors of maplets' centres.
    center : (3,) ndarray
        The middle of the scan, lidar coordinates, metres.
    surfaces, points : int
        Number of maplets that it crosses, and of its returns there.
    reason : str
        Why it is not observable; empty if it is.
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
        self, parts: list[SurfaceNormalEquations], names: tuple[str, ...], maplet_sigma_m: float
    ) -> ScanFit:
        """Return the fit after one Gauss–Newton step with the equations of the surfaces.

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
        """Return its entry of ``registration.json``.

        ``offset_m`` is the place of its middle by this fit minus that by `whole`.
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
        names, model = self.whole.parameters, self.whole.model
        apart = {id(grid) for grid in compared_grids(list(grids.values()))}
        chosen = [(name, grid) for name, grid in grids.items() if id(grid) in apart]
        store = self.source.store
        unknown = np.full((len(names),) * 2, np.inf)
        fits = {
            name: ScanFit(self.whole.transform, model, unknown, center)
            for name, center in zip(store.scan_names, store.arcs.center, strict=True)
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
        for scan in np.flatnonzero(counts >= _FEWEST).tolist():
            fit, chosen = self.fits[around.scan_names[scan]], around.scan == scan
            equations = surface_equations(
                CloudOfReturns(around.points[chosen], around.sigma[chosen]),
                fixed,
                fit.transform,
                fit.center,
                size=len(fit.covariance),
                min_coverage=0.0,
            )
            if equations is not None:
                found[around.scan_names[scan]] = equations
        return found
