"""Observations of the scale: displacements of the lidar surface relative to the SPC surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spcola.arrays import FloatArray, check_finite, check_shape
from spcola.errors import InvalidValueError

TrajectorySource = Literal["spc", "reference"]
"""Whose spacecraft positions locate the returns: those of the SPC solution, or of the lidar."""

PARAMETERS = (
    "epsilon",
    "cx_m",
    "cy_m",
    "cz_m",
    "rx_rad",
    "ry_rad",
    "rz_rad",
    "range_bias_m",
)
"""Order of the parameters of the joint estimate, and of its covariance."""


@dataclass(frozen=True, eq=False)
class ScaleObservations:
    """N comparisons of the lidar surface with the SPC surface.

    A pair of bigmaps gives three components of the displacement; a single shot gives one, the
    measured minus the predicted range.

    Parameters
    ----------
    kind : {"pairs", "shots"}
    label : tuple of str
        Image of each pair, or scan of each shot.
    day : tuple of str
        UTC date of each, ``YYYY-MM-DD``.
    value : (N, 3) or (N, 1) ndarray
        Lidar surface minus SPC surface, body-fixed, metres (pairs); measured minus predicted
        range, metres (shots).
    covariance : (N, 3, 3) or (N, 1, 1) ndarray
        Of the value, square metres.
    point : (N, 3) ndarray
        Surface points, body-fixed, metres.
    beam : (N, 3) ndarray
        Unit vector from the spacecraft to the point.
    range : (N,) ndarray
        Predicted range r, metres.
    normal : (N, 3) ndarray
        Outward unit normal of the surface there.
    local_time_h : (N,) ndarray
        Local solar time, hours; NaN if the Sun is not known.
    shares : (N, S) ndarray
        Shares of S shared sources of error in each observation: the states of the images between
        which a trajectory was interpolated, or the scan that it belongs to.
    trajectory : {"spc", "reference"}
        Trajectory by which the returns are located. With SPC's own, spacecraft and surface are
        scaled together, and a scale error appears as ε r along the beam: for ε > 0 ranges are
        longer than predicted. With an independent one it appears as ε times the surface point: the
        surface lies further out, and ranges are shorter than predicted.
    scan : tuple of str, optional
        Scan of each observation, whose pointing error is added to those of the states. By default
        no such error.
    response : (N, 3, 3 S) ndarray, optional
        Displacement of each comparison, per metre, by displacements of the sources of `shares`
        (three components each); a pair whose returns depend on several states is bent if these
        differ. By default the shares times the unit matrix.
    ground : (N, 3, K) ndarray, optional
        Displacement of each comparison by shared error patterns, of standard deviation 1, of the
        SPC surface, metres. `covariance` is the residual covariance.

    Raises
    ------
    InvalidValueError
        If shapes disagree or a number (except local time) is not finite.
    """

    kind: Literal["pairs", "shots"]
    label: tuple[str, ...]
    day: tuple[str, ...]
    value: FloatArray
    covariance: FloatArray
    point: FloatArray
    beam: FloatArray
    range: FloatArray
    normal: FloatArray
    local_time_h: FloatArray
    shares: FloatArray
    trajectory: TrajectorySource
    scan: tuple[str, ...] = ()
    response: FloatArray | None = None
    ground: FloatArray | None = None

    def __post_init__(self) -> None:
        count, size = self.value.shape
        if size != (3 if self.kind == "pairs" else 1):
            raise InvalidValueError(f"has {size} component(s)", f"value of {self.kind}")
        check_shape(self.covariance, (count, size, size), "covariance")
        check_shape(self.range, (count,), "range")
        check_shape(self.shares, (count, None), "shares")
        for name in ("value", "covariance", "point", "beam", "range", "normal", "shares"):
            check_finite(getattr(self, name), name)
        for name in ("point", "beam", "normal"):
            check_shape(getattr(self, name), (count, 3), name)
        if self.scan and len(self.scan) != count:
            raise InvalidValueError(f"names {len(self.scan)} scans of {count}", "scan")
        for name in ("response", "ground"):
            if (layer := getattr(self, name)) is not None:
                check_shape(layer, (count, 3, None), name)
                check_finite(layer, name)

    def __len__(self) -> int:
        return len(self.value)

    @property
    def source_displacements(self) -> FloatArray:
        """Displacements (N, 3, 3 S′) by the S′ sources with a share in any observation.

        Other sources have no effect and would only enlarge the matrices.
        """
        sources = self.shares.any(axis=0)
        if self.response is not None:
            return self.response[:, :, np.repeat(sources, 3)]
        return uniform_displacements(self.shares[:, sources])

    @property
    def longitude(self) -> FloatArray:
        """East longitude of the surface point (N,), radians, in [0, 2π)."""
        return np.arctan2(self.point[:, 1], self.point[:, 0]) % (2.0 * np.pi)

    @property
    def arm(self) -> FloatArray:
        """Vector (N, 3), metres, that a scale error multiplies: see `trajectory`."""
        if self.trajectory == "spc":
            return self.range[:, None] * self.beam
        return self.point

    @property
    def along_range(self) -> FloatArray:
        """Row vectors (N, 3) that convert a displacement to a change of range.

        A surface displaced by D is hit ``n·D / n·b`` further along the beam b.
        """
        cosine = np.sum(self.normal * self.beam, axis=1)
        return self.normal / cosine[:, None]

    def design(self) -> FloatArray:
        """Partial derivatives (N, D, 8) of the value with respect to :data:`PARAMETERS`.

        With δθ the rotation that takes lidar coordinates to SPC coordinates, the lidar surface
        lies at ``ε a + c − δθ × a + b β`` from the SPC surface (a: `arm`, c: offset of the
        centre, β: range bias along the beam b).
        """
        arm = self.arm
        turning = -np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=2)
        center = np.broadcast_to(np.eye(3), (len(self), 3, 3))
        displacement = np.concatenate(
            [arm[:, :, None], center, turning, self.beam[:, :, None]], axis=2
        )
        return self.as_observed(displacement)

    @property
    def sight(self) -> FloatArray:
        """Rows (N, 3) that convert an observed displacement to a range difference.

        The beam for pairs with SPC's trajectory (Δr along the line of sight); else
        :attr:`along_range`.
        """
        matched = self.kind == "pairs" and self.trajectory == "spc"
        return self.beam if matched else self.along_range

    def as_observed(self, displaced: FloatArray) -> FloatArray:
        """Convert displacements (N, 3, …) of the surfaces to changes of observations (N, D, …).

        A pair observes all three components, a shot the change of its range.
        """
        if self.kind == "pairs":
            return displaced
        return np.einsum("ni,ni...->n...", self.along_range, displaced)[:, None]

    def in_range(self, components: FloatArray) -> FloatArray:
        """Convert quantities (N, D, …) of the observations to ranges (N, …)."""
        if self.kind == "shots":
            return components[:, 0]
        return np.einsum("ni,ni...->n...", self.sight, components)

    @property
    def range_per_epsilon(self) -> FloatArray:
        """Derivative (N,), metres, of the range difference with respect to ε."""
        return np.sum(self.sight * self.arm, axis=1)

    @property
    def range_variance(self) -> FloatArray:
        """Variance (N,), m², of the range difference from the observation's own covariance."""
        if self.kind == "shots":
            return self.covariance[:, 0, 0]
        return np.einsum("ni,nij,nj->n", self.sight, self.covariance, self.sight)

    def epsilon(self) -> tuple[FloatArray, FloatArray]:
        """ε of each observation alone (N,), and its sigma from its own covariance (N,).

        All other parameters are assumed 0: ε = Δr / r with SPC's trajectory.
        """
        gain = self.range_per_epsilon
        return self.in_range(self.value) / gain, np.sqrt(self.range_variance) / np.abs(gain)


def uniform_displacements(shares: FloatArray) -> FloatArray:
    """Displacements (N, 3, 3 S) by sources with `shares` (N, S), the same in all directions."""
    return np.einsum("ns,di->ndsi", shares, np.eye(3)).reshape(len(shares), 3, -1)
