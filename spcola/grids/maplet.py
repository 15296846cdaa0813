"""Maplets: heights and relative albedo on a square grid in a local frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import (
    AnyArray,
    BoolArray,
    FloatArray,
    check_axes,
    check_finite,
    frozen,
    read_only,
)
from spcola.errors import InvalidValueError
from spcola.math import Affine, Similarity, local_axes


@dataclass(frozen=True, eq=False)
class MapletGrid:
    """Positions of the grid points of a maplet, mapola or bigmap.

    The grid point (m, n), with −q ≤ m, n ≤ q, lies on the reference plane at
    ``V + gsd (m Uy + n Ux)`` (Gaskell et al., eq. 15). **Arrays on the grid are indexed
    ``[m + q, n + q]``: rows run along Uy, columns along Ux.**

    Parameters
    ----------
    center : (3,) array_like
        V: the central vector, body-fixed, metres.
    axes : (3, 3) array_like
        Rows Ux, Uy, Uz: orthonormal, right-handed, Uz outward.
    gsd : float
        Ground sample distance, metres.
    half_size : int
        q; the grid has (2q + 1)² points.

    Raises
    ------
    InvalidValueError
        If a shape, the axes, the GSD or the half-size is not as stated.
    """

    center: FloatArray
    axes: FloatArray
    gsd: float
    half_size: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", frozen(self.center, (3,), "center"))
        object.__setattr__(self, "axes", frozen(self.axes, (3, 3), "axes"))
        check_finite(self.center, "center")
        check_axes(self.axes, "axes")
        if not (np.isfinite(self.gsd) and self.gsd > 0):
            raise InvalidValueError(f"must be positive, not {self.gsd} m", "gsd")
        if self.half_size < 1:
            raise InvalidValueError(f"must be at least 1, not {self.half_size}", "half_size")

    @classmethod
    def facing(cls, center: ArrayLike, normal: ArrayLike, gsd: float, half_size: int) -> MapletGrid:
        """Build a grid with Uz along `normal` and the usual axes of SPC, south and east.

        They are the orientation of published maplets, and those of :func:`spcola.math.local_axes`.

        Parameters
        ----------
        center : (3,) array_like
            V, body-fixed, metres.
        normal : (3,) array_like
            Any length but zero.
        gsd : float
            Metres.
        half_size : int
            q.
        """
        return cls(
            np.asarray(center, dtype=np.float64),
            local_axes(normal),
            gsd,
            half_size,
        )

    @property
    def size(self) -> int:
        """2q + 1: grid points along a side."""
        return 2 * self.half_size + 1

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of an array on this grid."""
        return (self.size, self.size)

    @property
    def ux(self) -> FloatArray:
        """Ux (3,): the direction of growing n (columns)."""
        return self.axes[0]

    @property
    def uy(self) -> FloatArray:
        """Uy (3,): the direction of growing m (rows)."""
        return self.axes[1]

    @property
    def uz(self) -> FloatArray:
        """Uz (3,): the outward normal of the reference plane."""
        return self.axes[2]

    @property
    def radius(self) -> float:
        """Distance from the centre to a corner of the reference plane, metres."""
        return float(np.sqrt(2.0) * self.half_size * self.gsd)

    @property
    def offsets(self) -> FloatArray:
        """−q … q as floats (2q + 1,): the grid index along either side."""
        return np.arange(-self.half_size, self.half_size + 1, dtype=np.float64)

    def points(self, height: ArrayLike) -> FloatArray:
        """Body-fixed positions (2q+1, 2q+1, 3), metres, of nodes at `height` (metres) [15].

        NaN heights give NaN points.
        """
        steps = self.gsd * self.offsets
        plane = steps[:, None, None] * self.uy + steps[None, :, None] * self.ux
        lifted = np.asarray(height, dtype=np.float64)[..., None] * self.uz
        return self.center + plane + lifted

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Project points (…, 3), metres, into the grid's frame [24].

        Returns
        -------
        x, y : ndarrays (…)
            In grid steps along Ux and Uy from the centre (x runs with n, y with m).
        height : ndarray (…)
            Along Uz, **metres**.
        """
        local = (np.asarray(points, dtype=np.float64) - self.center) @ self.axes.T
        return local[..., 0] / self.gsd, local[..., 1] / self.gsd, local[..., 2]

    def interpolated(self, layer: FloatArray, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return a layer (R, C) of the grid's points between them, bilinearly.

        Parameters
        ----------
        layer : (R, C) ndarray
        x, y : (...) array_like
            In grid steps from the centre, as of :meth:`project`; outside, the edge counts.

        Returns
        -------
        (...) ndarray
            NaN where a corner of the cell has none.
        """
        # A fifth of a second to import; who only reads maplets never needs it.
        from scipy import ndimage  # noqa: PLC0415

        places = np.stack([np.asarray(y), np.asarray(x)]) + self.half_size
        found: FloatArray = ndimage.map_coordinates(layer, places, order=1, mode="nearest")
        return found

    def moved(self, transform: Similarity | Affine) -> MapletGrid:
        """Return the grid with centre moved and axes rotated by `transform`; same GSD.

        This is how the mission moved mapolas (Gaskell et al. §6.1): centres and orientations
        change, heights and spacing do not. An affine map turns axes by its nearest rotation.
        """
        rotation = transform.nearest_similarity() if isinstance(transform, Affine) else transform
        axes = rotation.turn(self.axes)
        return replace(self, center=transform.apply(self.center), axes=axes)

    def with_gsd(self, gsd: float) -> MapletGrid:
        """Return a grid over (at least) the same square with another `gsd`, metres."""
        return replace(
            self, gsd=gsd, half_size=max(1, int(np.ceil(self.half_size * self.gsd / gsd - 1e-9)))
        )


@dataclass(frozen=True, eq=False)
class Maplet:
    """Heights and relative albedo on a :class:`MapletGrid`.

    A bigmap is the same, only larger. Points without a height are NaN.

    Parameters
    ----------
    name : str
        Name of the landmark or bigmap.
    grid : MapletGrid
        Frame and spacing.
    height : (2q+1, 2q+1) array_like
        Metres along Uz; NaN where unknown. Index ``[m + q, n + q]``.
    albedo : (2q+1, 2q+1) array_like, optional
        Relative albedo (1 + tz), 1 where unknown.
    sigma : (2q+1, 2q+1) array_like, optional
        One standard deviation of the height, metres; NaN where unknown.
    center_sigma : (3,) array_like, optional
        One standard deviation of V along the body-fixed axes, metres; NaN if unknown.

    Raises
    ------
    InvalidValueError
        If a layer has another shape, or a height or sigma is infinite or a sigma negative.
    """

    name: str
    grid: MapletGrid
    height: FloatArray
    albedo: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    sigma: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    center_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))

    def __post_init__(self) -> None:
        height = self._layer(self.height, 0.0, "height")
        albedo = self._layer(self.albedo, 1.0, "albedo")
        sigma = self._layer(self.sigma, np.nan, "sigma")
        if np.isinf(height).any() or np.isinf(sigma).any():
            raise InvalidValueError("contains an infinite height or sigma", self.name)
        if (sigma < 0).any():
            raise InvalidValueError("contains a negative sigma", self.name)
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "albedo", albedo)
        object.__setattr__(self, "sigma", sigma)
        object.__setattr__(self, "center_sigma", frozen(self.center_sigma, (3,), "center_sigma"))

    def _layer(self, values: ArrayLike | None, default: float, name: str) -> FloatArray:
        """Return a read-only float64 layer of the grid's shape (`default` everywhere if None)."""
        if values is None:
            return read_only(np.full(self.grid.shape, default))
        return frozen(values, self.grid.shape, f"{self.name}.{name}")

    @property
    def valid(self) -> BoolArray:
        """Mask (2q+1, 2q+1) of points whose height is known."""
        return np.isfinite(self.height)

    def points(self) -> FloatArray:
        """Body-fixed positions (2q+1, 2q+1, 3) of the surface, metres; NaN where unknown."""
        return self.grid.points(self.height)

    def with_layers(self, **layers: AnyArray | str) -> Self:
        """Return a copy with some layers (or the name) replaced."""
        return replace(self, **layers)  # type: ignore[arg-type]

    def moved(self, transform: Similarity | Affine) -> Self:
        """Return the maplet on ``grid.moved(transform)``: same heights, new place."""
        return replace(self, grid=self.grid.moved(transform))


def overlaps(one: MapletGrid, other: MapletGrid) -> bool:
    """Whether `one` grid and an `other` lie on the same side of the body and could share points."""
    apart = float(np.linalg.norm(one.center - other.center))
    return apart < one.radius + other.radius and float(one.uz @ other.uz) > 0.0
