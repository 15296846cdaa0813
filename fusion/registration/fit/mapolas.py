"""Matched mapolas with the errors that they share, and the fit of the transform to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.registration.fit.fit import FitOptions, Registration, fit_transform
from fusion.registration.fit.landmark_errors import LandmarkErrors
from fusion.registration.fit.scan_errors import ScanErrorPatterns
from fusion.surfacematch import Match
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import NotObservableError

# If the errors of landmarks are modelled, the prior of the remaining independent error is this
# share of the error of a maplet's centre.
_LEFT = 0.1


@dataclass(frozen=True, eq=False)
class MatchedMapolas:
    """Matches of N mapolas, including those that do not match, and their shared errors.

    Attributes
    ----------
    matches : sequence of Match
    scans : ScanErrorPatterns
    effects : (N, 3, M) ndarray
        ``scans.at`` of each mapola.
    residual_covariance : (N, 3, 3) ndarray
        ``scans.residual_covariance`` of each mapola, m².
    landmarks : LandmarkErrors, optional
        Errors of the maplets to which they were matched; unknown by default.
    """

    matches: Sequence[Match]
    scans: ScanErrorPatterns
    effects: FloatArray
    residual_covariance: FloatArray
    landmarks: LandmarkErrors | None = None

    @classmethod
    def of(
        cls,
        matches: Sequence[Match],
        scans: ScanErrorPatterns,
        shares: FloatArray,
    ) -> MatchedMapolas:
        """Return matches with the errors of scans at their places.

        Parameters
        ----------
        matches : sequence of Match
        scans : ScanErrorPatterns
        shares : (N, S) ndarray
            Share of each scan in the mapolas' returns.
        """
        centers = np.array([match.center for match in matches])
        residual = scans.residual_covariance(shares, centers)
        return cls(matches, scans, scans.at(shares, centers), residual)

    @property
    def usable(self) -> BoolArray:
        """Mask (N,) of those that match."""
        return np.array([match.usable for match in self.matches], dtype=bool)


def fit_mapolas(
    mapolas: MatchedMapolas, further: Sequence[FloatArray] = (), *, options: FitOptions
) -> Registration:
    """Fit the transform from lidar to SPC coordinates to the mapolas that match.

    Parameters
    ----------
    mapolas : MatchedMapolas
    further : sequence of (N, 3, M) ndarrays
        Patterns of shared errors other than those of scans and landmarks, metres.
    options : FitOptions

    Raises
    ------
    NotObservableError
        If there are too few, or their positions do not determine a parameter.
    """
    usable = mapolas.usable
    matches = [match for match in mapolas.matches if match.usable]
    if not matches:
        raise NotObservableError(
            f"none of {len(mapolas.matches)} mapolas matches ({mapolas.matches[0].reason})"
        )
    displacement = np.stack([match.displacement for match in matches])
    covariance = (
        np.stack([match.covariance for match in matches]) + mapolas.residual_covariance[usable]
    )
    groups = [group[usable] for group in further]
    landmarks = mapolas.landmarks
    if landmarks is not None:
        displacement = displacement - landmarks.offset[usable]
        covariance = covariance + landmarks.own[usable]
        groups.append(landmarks.shared[usable])
        options = replace(
            options,
            center_sigma_m=_LEFT * options.center_sigma_m,
            # The shared errors of landmarks are mostly not separable from the transform.
            fixed_groups=(*options.fixed_groups, len(groups)),
        )
    return fit_transform(
        np.stack([match.center for match in matches]),
        displacement,
        covariance,
        mapolas.effects[usable],
        further=groups,
        options=options,
    )
