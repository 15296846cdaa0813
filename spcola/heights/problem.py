"""The least-squares problem whose solution is a surface: energy (A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import BoolArray, FloatArray, check_shape, read_only
from spcola.errors import InvalidValueError
from spcola.heights.means import MeanConstraints


@dataclass(frozen=True, eq=False)
class HeightProblem:
    """Height steps between neighbours and heights of single points, each with its weight.

    The surface sought minimises, over the points of `mask`, ::

        E(h) = Σ_edges w_e (h(b) − h(a) − step_e)² + Σ_points w_c (h − h_c)²
               + Σ_sets w_k (mean of h over S_k − m_k)²                             (A)

    which, without the means, is the fixed point of the relaxation of Gaskell et al., eq. 23, if
    every ``w_e = 1``. Weights are inverse variances.

    Edges that touch a point outside `mask`, and heights that are NaN or outside it, get weight 0.

    Parameters
    ----------
    step_x : (R, C − 1) array_like
        ``h[r, c + 1] − h[r, c]`` as observed, metres; may be NaN where `weight_x` is 0.
    step_y : (R − 1, C) array_like
        ``h[r + 1, c] − h[r, c]`` as observed, metres; may be NaN where `weight_y` is 0.
    weight_x, weight_y : array_like
        1/m², of the shapes of the steps; 0 where the step is unknown.
    height : (R, C) array_like, optional
        Constraining heights h_c, metres; NaN where there is none.
    weight : (R, C) array_like, optional
        Their weights, 1/m².
    mask : (R, C) array_like, optional
        True at the points that are to get a height; everywhere if not given.
    means : MeanConstraints, optional
        Heights of areas. Points outside `mask` are left out of the mean.

    Raises
    ------
    InvalidValueError
        If shapes do not fit, a weight is negative or not finite, a height is infinite, or a
        step with a weight is not finite.
    """

    step_x: FloatArray
    step_y: FloatArray
    weight_x: FloatArray
    weight_y: FloatArray
    height: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    weight: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    mask: BoolArray = None  # type: ignore[assignment]  # filled in __post_init__
    means: MeanConstraints | None = None

    def __post_init__(self) -> None:
        shape = self._shape_from_steps()
        rows, columns = shape
        mask = np.ones(shape, dtype=bool) if self.mask is None else np.array(self.mask, dtype=bool)
        check_shape(mask, shape, "mask")
        self._keep("mask", mask)
        height = np.full(shape, np.nan) if self.height is None else self.height
        weight = np.zeros(shape) if self.weight is None else self.weight
        self._keep_heights(_floats(height), _weights(weight, shape, "weight"))
        self._keep_edges("x", (rows, columns - 1), mask[:, 1:], mask[:, :-1])
        self._keep_edges("y", (rows - 1, columns), mask[1:], mask[:-1])
        means = None if self.means is None else self.means.within(mask)
        object.__setattr__(
            self, "means", means if means is not None and len(means.height) else None
        )

    def with_data(
        self,
        step_x: FloatArray,
        step_y: FloatArray,
        height: FloatArray,
        *,
        mean_height: FloatArray | None = None,
    ) -> HeightProblem:
        """Return the problem of other steps and heights with the same mask and weights.

        Parameters
        ----------
        step_x : (R, C − 1) array_like
        step_y : (R − 1, C) array_like
            Metres; may be NaN where the weight is 0.
        height : (R, C) array_like
            Constraining heights, metres; may be NaN where the weight is 0.
        mean_height : (K,) ndarray, optional
            Heights of the sets in `means`, metres; the old ones if not given.

        Raises
        ------
        InvalidValueError
            If a shape does not fit, or a value with a weight is not finite.
        """
        other = object.__new__(HeightProblem)
        for name in ("mask", "weight", "weight_x", "weight_y"):
            object.__setattr__(other, name, getattr(self, name))
        for name, values in (("step_x", step_x), ("step_y", step_y), ("height", height)):
            weight = getattr(self, "weight" + name.removeprefix("step").removeprefix("height"))
            kept = np.array(_floats(values))
            check_shape(kept, weight.shape, name)
            if not _finite_where_used(kept, weight):
                raise InvalidValueError("is not finite where its weight is positive", name)
            if name != "height":
                kept[weight == 0] = 0.0
            other._keep(name, kept)
        means = self.means
        if means is not None and mean_height is not None:
            means = means.with_heights(mean_height)
        object.__setattr__(other, "means", means)
        return other

    def has_weights_of(self, other: HeightProblem) -> bool:
        """Whether mask and weights are those of `other` (the same arrays, not equal ones)."""
        mine, others = self.means, other.means
        if (mine is None) != (others is None):
            return False
        if mine is not None and others is not None and mine.points.base is not others.points.base:
            return False
        return all(
            getattr(self, name).base is getattr(other, name).base
            for name in ("mask", "weight", "weight_x", "weight_y")
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the surface."""
        rows, columns = self.mask.shape
        return (rows, columns)

    def _shape_from_steps(self) -> tuple[int, int]:
        """Return (R, C) from the shapes of the two step arrays."""
        step_x, step_y = np.asarray(self.step_x), np.asarray(self.step_y)
        check_shape(step_x, (None, None), "step_x")
        check_shape(step_y, (None, None), "step_y")
        rows, columns = step_x.shape[0], step_y.shape[1]
        if rows < 1 or columns < 1:
            raise InvalidValueError("the surface has no points", "step_x and step_y")
        check_shape(step_x, (rows, columns - 1), "step_x")
        check_shape(step_y, (rows - 1, columns), "step_y")
        return rows, columns

    def _keep(self, name: str, values: FloatArray | BoolArray) -> None:
        object.__setattr__(self, name, read_only(values))

    def _keep_heights(self, height: FloatArray, weight: FloatArray) -> None:
        """Store heights and their weights: 0 where there is no height or no point."""
        height, weight = np.array(height), np.array(weight)
        check_shape(height, self.mask.shape, "height")
        if np.isinf(height).any():
            raise InvalidValueError("contains an infinite height", "height")
        weight[~self.mask | np.isnan(height)] = 0.0
        self._keep("height", height)
        self._keep("weight", weight)

    def _keep_edges(
        self, axis: str, shape: tuple[int, int], one: BoolArray, other: BoolArray
    ) -> None:
        """Store steps and weights of one direction: both 0 where the edge is not used."""
        weight = np.array(_weights(getattr(self, f"weight_{axis}"), shape, f"weight_{axis}"))
        step = np.array(_floats(getattr(self, f"step_{axis}")))
        weight[~(one & other)] = 0.0
        if not _finite_where_used(step, weight):
            raise InvalidValueError(
                "is not finite where its weight is positive", f"step_{axis}", "set the weight to 0"
            )
        step[weight == 0] = 0.0
        self._keep(f"step_{axis}", step)
        self._keep(f"weight_{axis}", weight)


def _floats(values: ArrayLike) -> FloatArray:
    """Return `values` as float64, or as float32 if they are, in C order."""
    array = np.asarray(values)
    kind = np.float32 if array.dtype == np.float32 else np.float64
    return np.require(array, dtype=kind, requirements="C")


def _weights(values: ArrayLike, shape: tuple[int, int], name: str) -> FloatArray:
    """Return `values` as floats, refused unless finite, not negative and of `shape`."""
    weights = _floats(values)
    check_shape(weights, shape, name)
    if not ((weights >= 0) & (weights < np.inf)).all():
        raise InvalidValueError("contains a weight that is negative or not finite", name)
    return weights


def _finite_where_used(values: FloatArray, weights: FloatArray) -> bool:
    """Return whether every value with a weight is finite."""
    return bool((np.isfinite(values) | (weights == 0)).all())
