"""The transform of a single scan, from its returns on SPC surfaces, without mapolas."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.registration.direct import NormalEquations, modelled_covariance, pair_equations
from fusion.registration.returns.return_heights import (
    CloudOfReturns,
    FixedSurface,
    compared,
    height_of_returns,
)
from fusion.registration.transform import (
    TransformWithCovariance,
    about_origin,
    natural_sizes,
    transform_partials,
    updated_transform,
)
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.grids.correlation import independent_patches
from spcola.math import Affine

# Surfaces with fewer returns of a scan are not used for it.
_FEWEST_RETURNS = 200
# Fewest grid points with returns that determine seven parameters.
_FEWEST_POINTS = 30


@dataclass(frozen=True, eq=False)
class SurfaceNormalEquations:
    """Contribution of one surface to the normal equations of a transform.

    Attributes
    ----------
    equations : NormalEquations
        With the whole surface as one cluster.
    area : float
        Correlation area of its errors, cells.
    returns : int
        Number of returns.
    """

    equations: NormalEquations
    area: float
    returns: int


@dataclass(frozen=True, eq=False)
class ScanFit(TransformWithCovariance):
    """The transform of one scan, from adjusted lidar to SPC coordinates.

    It is the initial one if the scan does not determine it. The covariance is about the origin and
    includes the errors of maplets' centres.

    Attributes
    ----------
    center : (3,) ndarray
        The middle of the scan, lidar coordinates, metres.
    surfaces, points : int
        Number of maplets that it crosses, and of its returns there.
    reason : str
        Why it is not observable; empty if it is.
    """

    center: FloatArray
    surfaces: int = 0
    points: int = 0
    reason: str = ""

    def equations(
        self, returns: CloudOfReturns, fixed: FixedSurface
    ) -> SurfaceNormalEquations | None:
        """Return one surface's normal equations at this transform; None with too few returns.

        Parameters
        ----------
        returns : CloudOfReturns
            Those of the scan near the surface.
        fixed : FixedSurface
        """
        if len(returns) < _FEWEST_RETURNS:
            return None
        lidar = height_of_returns(returns, fixed, self.transform)
        if np.isfinite(lidar.height).mean() < _FEWEST_POINTS / lidar.height.size:
            return None
        pair = compared(lidar, fixed)
        equations = pair_equations(
            pair,
            fixed.grid,
            self.transform,
            self.center,
            size=len(self.parameters),
            block=len(pair.fixed),
        )
        difference = pair.fixed - pair.moving
        area = float(np.isfinite(difference).sum() / independent_patches(difference))
        return SurfaceNormalEquations(equations, area, len(returns))

    def stepped(self, parts: list[SurfaceNormalEquations], maplet_sigma_m: float) -> ScanFit:
        """Return the fit after one Gauss–Newton step with the equations of the surfaces.

        Parameters
        ----------
        parts : list of SurfaceNormalEquations
        maplet_sigma_m : float
            Error of a maplet's centre, each axis, metres.
        """
        counted = replace(self, surfaces=len(parts), points=sum(part.returns for part in parts))
        if not parts:
            reason = f"no maplet is covered by {_FEWEST_RETURNS} of its returns"
            return replace(counted, reason=reason)
        equations = [part.equations for part in parts]
        joined = NormalEquations.joined(equations)
        try:
            step = joined.solve(self.parameters, natural_sizes(self.parameters, _extent(joined)))
        except NotObservableError as error:
            return replace(counted, reason=error.what)
        covariance = modelled_covariance(equations, [part.area for part in parts], maplet_sigma_m)
        return replace(
            counted,
            transform=updated_transform(self.transform, step, self.model, self.center),
            covariance=about_origin(covariance, self.model, self.transform, self.center),
            reason="",
        )

    def entry(self, name: str, whole: Affine) -> dict[str, Any]:
        """Return the entry of the scan `name` in ``registration.json``.

        ``offset_m`` is the place of its middle by this fit minus that by `whole`, the transform of
        the mission.
        """
        entry: dict[str, Any] = {
            "scan": name,
            "maplets": self.surfaces,
            "returns": self.points,
            "reason": self.reason,
        }
        if self.reason:
            return entry
        scale, scale_sigma, rotation, rotation_sigma = self.similarity_numbers()
        row = transform_partials(self.model, self.similarity, self.center[None], np.zeros(3))[0]
        return entry | {
            "offset_m": self.transform.apply(self.center) - whole.apply(self.center),
            "offset_sigma_m": np.sqrt(np.diag(row @ self.covariance @ row.T)),
            "translation_m": self.transform.translation,
            "translation_sigma_m": np.sqrt(np.diag(self.covariance))[:3],
            "rotation_deg": np.degrees(rotation),
            "rotation_sigma_deg": np.degrees(rotation_sigma),
            "scale": scale,
            "scale_sigma": scale_sigma,
            "covariance": self.covariance,
        }


def _extent(equations: NormalEquations) -> float:
    """Distance, metres, at which rotations displace the observed ground as far as translations."""
    noisy = np.diag(equations.noisy)
    return float(np.sqrt(max(noisy[3:].mean() / max(noisy[:3].mean(), 1e-300), 1.0)))
