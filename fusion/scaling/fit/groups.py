"""Shared errors of the observations of the scale: of states, of days, of the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.scaling.fit.observation import ScaleObservations
from fusion.scaling.geometry.sharing import patterns
from spcola.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class ErrorGroups:
    """Displacements by shared errors, in groups of one unknown size each.

    Attributes
    ----------
    displaced : tuple of 3 (N, 3, R_g) ndarrays
        Displacement by each source, per unit of its size: of states and scans (metres per metre),
        of days (metres of range), of the ground (metres; its size is a factor).
    sizes : tuple of 3 float
        Prior medians of the sizes; 0 for an absent group.
    """

    displaced: tuple[FloatArray, FloatArray, FloatArray]
    sizes: tuple[float, float, float]

    @classmethod
    def of(
        cls, observations: ScaleObservations, state_sigma_m: float, scan_sigma_m: float,
        day_sigma_m: float,
    ) -> ErrorGroups:  # fmt: skip
        """Return the groups of `observations`; sizes are prior medians, metres per axis.

        If image states locate the returns, each scan has an additional pointing error of
        `scan_sigma_m`. It has one common size with the states, as the two are hardly separable.
        """
        sources = observations.source_displacements
        several = sources.shape[2] > 3
        if observations.trajectory == "spc" and state_sigma_m > 0 and observations.scan:
            pointing = pointing_of_scans(observations) * (scan_sigma_m / state_sigma_m)
            sources = np.concatenate([sources, pointing], axis=2)
        if several:
            sources = patterns(sources, state_sigma_m)
        days = members(observations.day)
        ground = observations.ground
        if ground is None:
            ground = np.zeros((len(observations), 3, 0))
        return cls(
            # The shared error of a day is a range error, along the beam.
            (sources, observations.beam[:, :, None] * days[:, None, :], ground),
            (
                state_sigma_m if several else 0.0,
                day_sigma_m if days.shape[1] > 1 else 0.0,
                1.0 if ground.shape[2] else 0.0,
            ),
        )

    def as_observed(self, observations: ScaleObservations) -> tuple[FloatArray, ...]:
        """Effect on the observations: three (N, D, R_g) ndarrays."""
        return tuple(observations.as_observed(group) for group in self.displaced)

    def in_range(self, observations: ScaleObservations) -> tuple[FloatArray, ...]:
        """Effect on ranges: three (N, 1, R_g) ndarrays, metres."""
        return tuple(
            np.einsum("ni,nir->nr", observations.sight, group)[:, None] for group in self.displaced
        )


def pointing_of_scans(observations: ScaleObservations) -> FloatArray:
    """Displacements (N, 3, 3 S) by a rotation of each scan's beams, per metre on the ground.

    They are perpendicular to the beam and proportional to the range.
    """
    member = members(observations.scan)
    mean = member.T @ observations.range / member.sum(axis=0)
    beam = observations.beam
    across = np.eye(3) - beam[:, :, None] * beam[:, None, :]
    reach = member * observations.range[:, None] / mean
    return np.einsum("ns,ndi->ndsi", reach, across).reshape(len(beam), 3, -1)


def members(labels: tuple[str, ...]) -> FloatArray:
    """Membership (N, L), 1 or 0, of N items in the L sorted labels."""
    known = sorted(set(labels))
    return np.array([[label == other for other in known] for label in labels], dtype=np.float64)
