"""Heights of areas: constraints on the mean of a surface over several grid points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import BoolArray, FloatArray, IntArray, check_shape, frozen, read_only
from spcola.compilation import compiled
from spcola.errors import InvalidValueError

Sets = tuple[IntArray, IntArray, FloatArray]
"""`start`, `points` and `share` of :class:`MeanConstraints`."""


@dataclass(frozen=True, eq=False)
class MeanConstraints:
    """Σ_k w_k (Σ_i share_i h_i − m_k)², the sum of i over the points of set k.

    A coarse cell of a mapola gives the mean height of the fine points in it, and no detail between
    them. Sets may overlap.

    Parameters
    ----------
    start : (K + 1,) integer array_like
        Set k has the entries ``start[k] : start[k + 1]`` of `points` and `share`.
    points : (n,) integer array_like
        Flat indices (row × columns + column) into the grid.
    share : (n,) array_like
        Positive; they sum to 1 in a set for a mean.
    height : (K,) array_like
        Mean heights m_k, metres.
    weight : (K,) array_like
        1/m².

    Raises
    ------
    InvalidValueError
        If lengths do not fit, a share is not positive, a weight negative, or a value not finite.
    """

    start: IntArray
    points: IntArray
    share: FloatArray
    height: FloatArray
    weight: FloatArray

    def __post_init__(self) -> None:
        start = np.array(self.start, dtype=np.int64)
        points = np.array(self.points, dtype=np.int64)
        check_shape(start, (None,), "start")
        check_shape(points, (None,), "points")
        if (
            len(start) == 0
            or start[0] != 0
            or start[-1] != len(points)
            or (np.diff(start) < 0).any()
        ):
            raise InvalidValueError("does not divide the points into sets", "start")
        sets = len(start) - 1
        share = frozen(self.share, (len(points),), "share")
        height = frozen(self.height, (sets,), "height")
        weight = frozen(self.weight, (sets,), "weight")
        if not (np.isfinite(height).all() and np.isfinite(weight).all() and (weight >= 0).all()):
            raise InvalidValueError(
                "contains a value that is negative or not finite", "weight or height"
            )
        if not (np.isfinite(share).all() and (share > 0).all()):
            raise InvalidValueError("contains a value that is not positive", "share")
        object.__setattr__(self, "start", read_only(start))
        object.__setattr__(self, "points", read_only(points))
        object.__setattr__(self, "share", share)
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "weight", weight)

    @classmethod
    def of_labels(cls, labels: ArrayLike, height: ArrayLike, weight: ArrayLike) -> MeanConstraints:
        """Return means over the areas of a label image.

        Parameters
        ----------
        labels : (R, C) integer array_like
            The area 0 … K − 1 that each point belongs to; negative: none.
        height, weight : (K,) array_like
            Mean height (metres; NaN: not known) and weight (1/m²) of each area.
        """
        flat = np.asarray(labels).ravel()
        heights = np.asarray(height, dtype=np.float64)
        weights = np.where(np.isfinite(heights), weight, 0.0)
        points = np.flatnonzero(flat >= 0)
        points = points[np.argsort(flat[points], kind="stable")]
        if len(points) and flat[points[-1]] >= len(heights):
            raise InvalidValueError(f"has an area beyond the {len(heights)} heights", "labels")
        size = np.bincount(flat[points], minlength=len(heights))
        share = 1.0 / np.maximum(size, 1)[flat[points]]
        start = np.concatenate([[0], np.cumsum(size)])
        return cls(start, points, share, np.nan_to_num(heights), weights)

    @property
    def sets(self) -> Sets:
        """The areas, without their heights and weights."""
        return (self.start, self.points, self.share)

    @property
    def owner(self) -> IntArray:
        """Set (n,) that each entry belongs to."""
        return np.repeat(np.arange(len(self.height)), np.diff(self.start))

    def within(self, mask: BoolArray) -> MeanConstraints:
        """Return the means over the points of `mask`; sets without points or weight are dropped.

        The remaining shares of a set are scaled to their old sum.
        """
        if len(self.points) and (self.points.min() < 0 or self.points.max() >= mask.size):
            raise InvalidValueError("lie outside the grid", "points of a mean")
        owner = self.owner
        keep = mask.ravel()[self.points] & (self.weight > 0)[owner]
        whole = np.bincount(owner, self.share, len(self.height))
        left = np.bincount(owner[keep], self.share[keep], len(self.height))
        scale = np.divide(whole, left, out=np.zeros(len(whole)), where=left > 0)
        return self._chosen(keep, self.share * scale[owner])

    def inside(self, rows: slice, columns: slice, width: int, *, whole: bool) -> MeanConstraints:
        """Return the means within a window of a grid, in the window's indices.

        The window has the `rows` and `columns` of a grid that is `width` columns wide. Sets that
        reach out of it are dropped if `whole`, else cut, with the heights outside fixed.
        """
        r, c = np.divmod(self.points, width)
        keep = (r >= rows.start) & (r < rows.stop) & (c >= columns.start) & (c < columns.stop)
        if whole:
            cut = np.bincount(self.owner[~keep], minlength=len(self.height)) > 0
            keep &= ~cut[self.owner]
        moved = (r - rows.start) * (columns.stop - columns.start) + (c - columns.start)
        return self._chosen(keep, self.share, np.where(keep, moved, 0))

    def transposed(self, shape: tuple[int, int]) -> MeanConstraints:
        """Return the same means on the transposed grid; `shape` is that before transposing."""
        r, c = np.divmod(self.points, shape[1])
        return MeanConstraints(self.start, c * shape[0] + r, self.share, self.height, self.weight)

    def with_heights(self, height: FloatArray) -> MeanConstraints:
        """Return the same sets with other mean heights `height` (K,), metres."""
        other = object.__new__(MeanConstraints)
        for name in ("start", "points", "share", "weight"):
            object.__setattr__(other, name, getattr(self, name))
        kept = frozen(height, self.height.shape, "height")
        if not np.isfinite(kept).all():
            raise InvalidValueError("contains a value that is not finite", "height of a mean")
        object.__setattr__(other, "height", kept)
        return other

    def lumped(self, shape: tuple[int, int]) -> FloatArray:
        """Return ``Σ_k w_k share_i Σ_j share_j`` at each point of a grid of `shape`, 1/m².

        As a diagonal matrix it is an upper bound.
        """
        whole = np.bincount(self.owner, self.share, len(self.height))
        each = (self.weight * whole)[self.owner] * self.share
        summed: FloatArray = np.zeros(shape[0] * shape[1])
        np.add.at(summed, self.points, each)
        return summed.reshape(shape)

    def _chosen(
        self, keep: BoolArray, share: FloatArray, points: IntArray | None = None
    ) -> MeanConstraints:
        """Return the entries of `keep` with new shares; sets that become empty are dropped."""
        count = np.bincount(self.owner[keep], minlength=len(self.height))
        left = count > 0
        return MeanConstraints(
            np.concatenate([[0], np.cumsum(count[left])]),
            (self.points if points is None else points)[keep],
            share[keep],
            self.height[left],
            self.weight[left],
        )


@compiled
def add_mean_pulls(
    sets: Sets, height: FloatArray, weight: FloatArray, x: FloatArray, out: FloatArray
) -> None:
    """Add to `out` the residual of the means at heights `x` (both (R, C)), times their weights."""
    start, points, share = sets
    columns = x.shape[1]
    for k in range(len(height)):
        misfit = height[k]
        for n in range(start[k], start[k + 1]):
            misfit -= share[n] * x[points[n] // columns, points[n] % columns]
        for n in range(start[k], start[k + 1]):
            out[points[n] // columns, points[n] % columns] += weight[k] * share[n] * misfit


@compiled
def add_mean_products(
    sets: Sets, weight: FloatArray, unit: float, p: FloatArray, out: FloatArray
) -> float:
    """Replace the lumped means in `out`, A p, by the means; return the change of pᵀ A p."""
    start, points, share = sets
    columns = p.shape[1] - 2
    change = 0.0
    for k in range(len(weight)):
        mean, whole = 0.0, 0.0
        for n in range(start[k], start[k + 1]):
            mean += share[n] * p[points[n] // columns + 1, points[n] % columns + 1]
            whole += share[n]
        for n in range(start[k], start[k + 1]):
            r, c = points[n] // columns + 1, points[n] % columns + 1
            pull = weight[k] / unit * share[n] * (mean - whole * p[r, c])
            out[r, c] += pull
            change += pull * p[r, c]
    return change
