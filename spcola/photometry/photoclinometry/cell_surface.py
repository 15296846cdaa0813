"""Heights from what cells between four points observe: slopes along any direction, mean heights.

Unlike :class:`spcola.heights.HeightProblem`, whose steps between two points are independent, a cell
has a 3 × 3 information matrix of (∂h/∂x, ∂h/∂y, h): where images determine one direction of the
slope only, that direction enters and the other does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dtrtri

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.compilation import compiled, compiled_inline, compiled_sums
from spcola.heights import inverse_entries
from spcola.photometry.photoclinometry.posterior import Posterior

# Of the heights' changes in a round, relative: the next round corrects what is left.
TOLERANCE = 1e-3
_MOST_ITERATIONS = 40
# Columns of a factor that are subtracted from the following ones at once: memory, not arithmetic,
# limits the factorisation.
_COLUMNS = 4


@dataclass(frozen=True, eq=False)
class CellInformation:
    """Information of cells on slopes and mean height, with common nuisance parameters.

    Parameters
    ----------
    normal : (6, R − 1, C − 1) ndarray
        Upper triangle, row by row, of the information of (∂h/∂x, ∂h/∂y, h) of each cell.
    right : (3, R − 1, C − 1) ndarray
        Right-hand sides.
    coupled : (P, R, C) ndarray
        Products of the heights of the points with the P nuisance parameters.
    nuisance : (P, P) ndarray
        Normal matrix of the nuisance parameters.
    nuisance_right : (P,) ndarray
    """

    normal: FloatArray
    right: FloatArray
    coupled: FloatArray
    nuisance: FloatArray
    nuisance_right: FloatArray


class CellSurface:
    """Normal equations of the heights (R, C) of a grid, from cells and points.

    Parameters
    ----------
    cells : CellInformation
    gsd : float
        Metres.
    known : (5, R, C) ndarray
        Normal matrix of what else is known of heights, 1/m²: products of each point with itself,
        and with the points next to it, below left, below, and below right.
    right : (R, C) ndarray
        Right-hand sides of that.
    twist : (R − 1, C − 1) ndarray
        Weight of ``h00 − h01 − h10 + h11`` of each cell, 1/m²: cells do not see it.
    """

    def __init__(
        self,
        cells: CellInformation,
        gsd: float,
        known: FloatArray,
        right: FloatArray,
        twist: FloatArray,
    ) -> None:
        self._shape = right.shape
        self._diagonals = np.array(known)
        self._right = np.array(right)
        _assemble(cells.normal, cells.right, twist, gsd, self._diagonals, self._right)
        count = len(cells.nuisance)
        self._coupled = cells.coupled.reshape(count, right.size)
        self._nuisance_normal = cells.nuisance
        self._nuisance = cho_factor(cells.nuisance) if count else None
        self._nuisance_right = cells.nuisance_right
        self._factor = self._band()
        _factorise(self._factor)

    def _band(self) -> FloatArray:
        """Return the lower band: row j has the matrix at (j + k, j) in column k.

        The last columns are 0 and stay so: blocks of columns of the factor reach there.
        """
        rows, columns = self._shape
        band = np.zeros((rows * columns, columns + 1 + _COLUMNS))
        places = (0, 1, columns - 1, columns, columns + 1)
        for place, diagonal in zip(places, self._diagonals, strict=True):
            band[:, place] += diagonal.ravel()
        return band

    def solve(self, *, tolerance: float = TOLERANCE) -> tuple[FloatArray, FloatArray]:
        """Return heights (R, C), metres, and nuisance parameters (P,).

        `tolerance` is the norm of what is left of the residual in that of the matrix's inverse,
        relative to the right-hand side's.
        """
        right = self._right.ravel().copy()
        if self._nuisance is not None:
            _subtract_rows(cho_solve(self._nuisance, self._nuisance_right), self._coupled, right)
        x = self._conjugate(right, tolerance)
        if self._nuisance is None:
            return x.reshape(self._shape), np.zeros(0)
        left = self._nuisance_right - self._with_nuisances(x)
        return x.reshape(self._shape), cho_solve(self._nuisance, left)

    def _conjugate(self, right: FloatArray, tolerance: float) -> FloatArray:
        """Conjugate gradients, preconditioned by the factor without nuisance parameters."""
        x = np.zeros(right.size)
        residual = right.copy()
        z = self._direct(residual)
        direction, product = z, float(residual @ z)
        first = product
        for _ in range(_MOST_ITERATIONS):
            if not product > tolerance**2 * first:
                break
            image = self._times(direction)
            step = product / float(direction @ image)
            x += step * direction
            residual -= step * image
            z = self._direct(residual)
            following = float(residual @ z)
            direction = z + (following / product) * direction
            product = following
        return x

    def _with_nuisances(self, x: FloatArray) -> FloatArray:
        """Return the products (P,) of the nuisance parameters with heights."""
        products = np.empty(len(self._coupled))
        _multiply_rows(self._coupled, x, products)
        return products

    def _direct(self, right: FloatArray) -> FloatArray:
        solved = right.copy()
        _substitute(self._factor, solved)
        return solved

    def _direct_of_nuisances(self) -> tuple[FloatArray, FloatArray]:
        """Return the solutions (P, points) for the products with the nuisance parameters.

        And the products (P, P) of these with them. With so many right-hand sides, products of full
        matrices are faster than substitution column by column.
        """
        solved = np.array(self._coupled, dtype=np.float64)
        blocks = self._blocks() if len(solved) else []
        for own, after, inverse, right in blocks:
            solved[:, own] = solved[:, own] @ inverse
            solved[:, after] -= solved[:, own] @ right
        products = solved @ solved.T
        for own, after, inverse, right in reversed(blocks):
            solved[:, own] = (solved[:, own] - solved[:, after] @ right.T) @ inverse.T
        return solved, products

    def _blocks(self) -> list[tuple[slice, slice, FloatArray, FloatArray]]:
        """Return the factor, transposed, in blocks of rows as high as the band is wide.

        Of each the rows, those of the next, the inverse of the matrix on the diagonal, and the
        matrix right of it.
        """
        size, width = len(self._factor), self._shape[1] + 1
        found = []
        for first in range(0, size, width):
            last, end = min(first + width, size), min(first + 2 * width, size)
            # Rows of 2 W + 1 numbers, read as rows of 2 W, lie one further to the right each.
            whole = np.zeros((width, 2 * width + 1))
            whole[: last - first, : width + 1] = self._factor[first:last, : width + 1]
            rows = whole.reshape(-1)[: 2 * width * width].reshape(width, 2 * width)
            rows = rows[: last - first, : end - first]
            upper, right = rows[:, : last - first], rows[:, last - first :]
            inverse, _ = dtrtri(upper)
            found.append((slice(first, last), slice(last, end), inverse, right))
        return found

    def _times(self, x: FloatArray) -> FloatArray:
        out = np.empty(x.size)
        _multiply(self._diagonals.reshape(5, -1), self._shape[1], x, out)
        if self._nuisance is not None:
            _subtract_rows(cho_solve(self._nuisance, self._with_nuisances(x)), self._coupled, out)
        return out

    def posterior(self, considered: BoolArray | None = None, sigma: float = 0.0) -> Posterior:
        """Return the covariances of the heights; errors of nuisance parameters enter.

        Parameters
        ----------
        considered : (P,) ndarray of bool, optional
            Nuisance parameters that are not estimated: see :class:`Posterior`.
        sigma : float
            Standard deviation of each of these.
        """
        count, columns = len(self._coupled), self._shape[1]
        apart = np.array([0, 1, columns - 1, columns, columns + 1])
        near = inverse_entries(self._factor, apart).reshape(5, *self._shape)
        solved, products = self._direct_of_nuisances()
        fixed = np.zeros(count, dtype=np.bool_) if considered is None else considered
        by_nuisance = solved.reshape(count, *self._shape)
        return Posterior(near, by_nuisance, self._nuisance_normal - products, fixed, sigma)


@compiled
def _assemble(
    normal: FloatArray,
    right: FloatArray,
    twist: FloatArray,
    gsd: float,
    diagonals: FloatArray,
    out: FloatArray,
) -> None:
    """Add each cell to its points: itself, next, below left, below, below right."""
    half = 0.5 / gsd
    square = half * half
    for i in range(twist.shape[0]):
        for j in range(twist.shape[1]):
            xx, xy, yy = (
                square * normal[0, i, j],
                square * normal[1, i, j],
                square * normal[3, i, j],
            )
            xh, yh = 0.25 * half * normal[2, i, j], 0.25 * half * normal[4, i, j]
            hh = 0.0625 * normal[5, i, j]
            t = twist[i, j]
            for a in range(4):
                # Corners 00, 01, 10, 11.
                ay, ax = a // 2, a % 2
                sx, sy = 2.0 * ax - 1.0, 2.0 * ay - 1.0
                out[i + ay, j + ax] += (
                    half * (sx * right[0, i, j] + sy * right[1, i, j]) + 0.25 * right[2, i, j]
                )
                for b in range(a, 4):
                    by, bx = b // 2, b % 2
                    rx, ry = 2.0 * bx - 1.0, 2.0 * by - 1.0
                    value = (
                        sx * rx * xx
                        + (sx * ry + sy * rx) * xy
                        + (sx + rx) * xh
                        + sy * ry * yy
                        + (sy + ry) * yh
                        + hh
                        + sx * sy * rx * ry * t
                    )
                    down, over = by - ay, bx - ax
                    place = 3 + over if down else over
                    diagonals[place, i + ay, j + ax] += value


@compiled
def _multiply(diagonals: FloatArray, columns: int, x: FloatArray, out: FloatArray) -> None:
    """Symmetric product with five diagonals."""
    size = x.size
    for k in range(size):
        out[k] = diagonals[0, k] * x[k]
    for d in range(1, 5):
        apart = 1 if d == 1 else columns + d - 3
        for k in range(size - apart):
            out[k] += diagonals[d, k] * x[k + apart]
            out[k + apart] += diagonals[d, k] * x[k]


@compiled_sums
def _multiply_rows(rows: AnyArray, x: FloatArray, out: FloatArray) -> None:
    """Fill `out` (P,) with the products of rows (P, N), of either precision, with x (N,).

    NumPy would convert all rows to the precision of x, each time. Two rows at once read it once.
    """
    for first in range(0, out.size, 2):
        second = min(first + 1, out.size - 1)
        one, other, total, another = rows[first], rows[second], 0.0, 0.0
        for k in range(x.size):
            total += one[k] * x[k]
            another += other[k] * x[k]
        out[first], out[second] = total, another


@compiled
def _subtract_rows(factors: FloatArray, rows: AnyArray, out: FloatArray) -> None:
    """Subtract from `out` (N,) rows (P, N), of either precision, each times its factor."""
    for first in range(0, factors.size, 2):
        second = min(first + 1, factors.size - 1)
        one, other, factor = rows[first], rows[second], factors[first]
        another = factors[second] if second > first else 0.0
        for k in range(out.size):
            out[k] -= factor * one[k] + another * other[k]


@compiled
def _factorise(band: FloatArray) -> None:
    """Replace a lower band (N, W + 1), row j of which has column j, by its Cholesky factor.

    The last columns of the band are 0. A library's would use threads, which wait for each other
    while other maplets use the cores.
    """
    size, width = band.shape[0], band.shape[1] - 1
    for first in range(0, size, _COLUMNS):
        after = min(first + _COLUMNS, size)
        for j in range(first, after):
            own = band[j]
            pivot = np.sqrt(own[0])
            for k in range(width + 1):
                own[k] /= pivot
            for column in range(j + 1, after):
                _subtract(band[column], own, column - j)
        last = min(after + width - _COLUMNS + 1, size)
        for column in range(after, last):
            k = column - first
            _subtract_four(
                band[column], band[first], band[first + 1], band[first + 2], band[first + 3], k
            )


@compiled_inline
def _subtract(column: FloatArray, own: FloatArray, k: int) -> None:
    """Subtract from a column of a band what an earlier one, k before it, contributes."""
    factor, rest = own[k], own[k:]
    for m in range(rest.size):
        column[m] -= factor * rest[m]


@compiled_inline
def _subtract_four(
    column: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, k: int
) -> None:
    """Subtract from a column of a band what four earlier ones, the first k before it, contribute.

    The last three numbers of each are 0.
    """
    fa, fb, fc, fd = a[k], b[k - 1], c[k - 2], d[k - 3]
    ra, rb, rc, rd = a[k:], b[k - 1 :], c[k - 2 :], d[k - 3 :]
    for m in range(ra.size):
        column[m] -= fa * ra[m] + fb * rb[m] + fc * rc[m] + fd * rd[m]


@compiled_sums
def _substitute(factor: FloatArray, x: FloatArray) -> None:
    """Replace a right-hand side (N,) by the solution."""
    size, width = factor.shape[0], factor.shape[1] - 1
    for j in range(size):
        most = min(width, size - 1 - j)
        value = x[j] / factor[j, 0]
        x[j] = value
        # Slices do not overlap `value`, so that the loops are vectorised.
        own, after = factor[j, 1 : most + 1], x[j + 1 : j + most + 1]
        for k in range(most):
            after[k] -= own[k] * value
    for j in range(size - 1, -1, -1):
        most = min(width, size - 1 - j)
        own, after = factor[j, 1 : most + 1], x[j + 1 : j + most + 1]
        total = 0.0
        for k in range(most):
            total += own[k] * after[k]
        x[j] = (x[j] - total) / factor[j, 0]
