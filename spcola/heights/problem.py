"""The least-squares problem whose solution is a surface: energy (A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, check_shape, frozen, read_only
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class HeightProblem:
    """Height steps between neighbours and heights of single points, each with its weight.

    The surface sought minimises, over the points of `mask`,

        E(h) = Σ_edges w_e (h(b) − h(a) − step_e)² + Σ_points w_c (h − h_c)²        (A)

    which is the fixed point of the relaxation of Gaskell et al., eq. 23, if every ``w_e = 1``.
    Weights are inverse variances, so that the steps of one source and the heights of another
    can be told apart by their uncertainties.

    Edges that touch a point outside `mask`, and heights that are NaN or lie outside it, do not
    take part: their weights are kept as 0, whatever was given.

    Parameters
    ----------
    step_x : (R, C − 1) array_like
        ``h[r, c + 1] − h[r, c]`` as it should be, metres; may be NaN where `weight_x` is 0.
    step_y : (R − 1, C) array_like
        ``h[r + 1, c] − h[r, c]`` as it should be, metres; may be NaN where `weight_y` is 0.
    weight_x, weight_y : array_like
        1/m², of the shapes of the steps; 0 where the step is not known.
    height : (R, C) array_like, optional
        Constraining heights h_c, metres; NaN where there is none.
    weight : (R, C) array_like, optional
        Their weights, 1/m².
    mask : (R, C) array_like, optional
        True at the points that are to get a height; everywhere if not given.

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

    def __post_init__(self) -> None:
        shape = self._shape_from_steps()
        rows, columns = shape
        mask = np.ones(shape, dtype=bool) if self.mask is None else np.array(self.mask, dtype=bool)
        check_shape(mask, shape, "mask")
        height = np.full(shape, np.nan) if self.height is None else self.height
        weight = np.zeros(shape) if self.weight is None else self.weight
        height, weight = frozen(height, shape, "height"), _weights(weight, shape, "weight")
        if np.isinf(height).any():
            raise InvalidValueError("holds an infinite height", "height")
        self._keep("mask", mask)
        self._keep("height", height)
        self._keep("weight", np.where(mask & np.isfinite(height), weight, 0.0))
        self._keep_edges("x", (rows, columns - 1), mask[:, 1:] & mask[:, :-1])
        self._keep_edges("y", (rows - 1, columns), mask[1:] & mask[:-1])

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the surface."""
        rows, columns = self.mask.shape
        return (rows, columns)

    def _shape_from_steps(self) -> tuple[int, int]:
        """Return (R, C) as the two step arrays together say it."""
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

    def _keep_edges(self, axis: str, shape: tuple[int, int], joined: BoolArray) -> None:
        """Keep steps and weights of one direction: both 0 where the edge does not take part."""
        weight = _weights(getattr(self, f"weight_{axis}"), shape, f"weight_{axis}")
        weight = np.where(joined, weight, 0.0)
        step = np.array(getattr(self, f"step_{axis}"), dtype=np.float64)
        step[weight == 0] = 0.0
        if not np.isfinite(step).all():
            raise InvalidValueError(
                "is not finite where its weight is positive", f"step_{axis}", "set the weight to 0"
            )
        self._keep(f"step_{axis}", step)
        self._keep(f"weight_{axis}", weight)


def _weights(values: FloatArray, shape: tuple[int, int], name: str) -> FloatArray:
    """Return `values` as float64, refused unless finite, not negative and of `shape`."""
    weights = np.asarray(values, dtype=np.float64)
    check_shape(weights, shape, name)
    if not (np.isfinite(weights).all() and (weights >= 0).all()):
        raise InvalidValueError("holds a weight that is negative or not finite", name)
    return weights
