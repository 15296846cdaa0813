"""Time the solver of energy (A) beside its peers: a table, all measured in this run.

The problem: slopes of a rough surface over a mask with holes and islands, 2 % of the heights as
constraints. The error is the largest distance to the surface that was planted.

    python scripts/bench/heights.py [--sizes 99 501 1001] [--tolerance-m 1e-6]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter
from scipy.sparse.linalg import LinearOperator, cg, spsolve

from spcola.arrays import FloatArray
from spcola.heights import HeightProblem, SolverOptions, posterior_sigma, solve_heights
from spcola.heights.components import find_components
from spcola.heights.direct import normal_matrix

DIRECT_LIMIT = 501
POSTERIOR_LIMIT = 99


def planted_problem(size: int) -> tuple[HeightProblem, FloatArray]:
    """Return a problem over 64 % of a grid, every part constrained, and its surface."""
    rng = np.random.default_rng(0)
    pattern = gaussian_filter(rng.normal(size=(size, size)), 4)
    height = 50 * gaussian_filter(rng.normal(size=(size, size)), 6)
    mask = pattern > np.quantile(pattern, 0.36)
    known = np.where(rng.random((size, size)) < 0.02, height, np.nan)
    step_x, step_y = np.diff(height, axis=1), np.diff(height, axis=0)
    layers = (step_x, step_y, np.ones(step_x.shape), np.ones(step_y.shape), known)
    problem = HeightProblem(*layers, np.ones(mask.shape), mask)
    mask = mask & ~find_components(problem).is_floating
    return HeightProblem(*layers, np.ones(mask.shape), mask), height


def right_side(problem: HeightProblem) -> FloatArray:
    """Return ``Dᵀ w_e step + w_c h_c`` over the points of the mask (n,)."""
    right = problem.weight * np.nan_to_num(problem.height)
    pull_x, pull_y = problem.weight_x * problem.step_x, problem.weight_y * problem.step_y
    right[:, 1:] += pull_x
    right[:, :-1] -= pull_x
    right[1:] += pull_y
    right[:-1] -= pull_y
    return right[problem.mask]


def by_multigrid(problem: HeightProblem, tolerance_m: float) -> tuple[FloatArray, int]:
    solution = solve_heights(problem, options=SolverOptions(tolerance_m=tolerance_m))
    return solution.height[problem.mask], solution.iterations


def by_direct(problem: HeightProblem, _tolerance_m: float) -> tuple[FloatArray, int]:
    matrix = normal_matrix(problem, problem.weight)
    return spsolve(matrix, right_side(problem), permc_spec="MMD_AT_PLUS_A"), 1


def by_dct(problem: HeightProblem, tolerance_m: float) -> tuple[FloatArray, int]:
    """Conjugate gradients with the whole rectangle's Poisson equation as preconditioner."""
    rows, columns = problem.shape
    y, x = np.arange(rows)[:, None], np.arange(columns)
    eigenvalues = 4 - 2 * np.cos(np.pi * y / rows) - 2 * np.cos(np.pi * x / columns)
    eigenvalues += float(np.mean(problem.weight[problem.mask]))

    def poisson(residual: FloatArray) -> FloatArray:
        whole = np.zeros(problem.shape)
        whole[problem.mask] = residual.ravel()
        return idctn(dctn(whole, norm="ortho") / eigenvalues, norm="ortho")[problem.mask]

    matrix = normal_matrix(problem, problem.weight)
    count = 0

    def counted(_: FloatArray) -> None:
        nonlocal count
        count += 1

    operator = LinearOperator(matrix.shape, matvec=poisson, dtype=np.float64)
    height, _ = cg(
        matrix, right_side(problem), rtol=0, atol=0.1 * tolerance_m, M=operator, callback=counted
    )
    return height, count


Solver = Callable[[HeightProblem, float], tuple[FloatArray, int]]
SOLVERS: dict[str, Solver] = {
    "multigrid CG (spcola)": by_multigrid,
    "DCT-preconditioned CG": by_dct,
    "sparse direct (SuperLU)": by_direct,
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the height solver beside its peers.")
    parser.add_argument("--sizes", type=int, nargs="+", default=[99, 501, 1001])
    parser.add_argument("--tolerance-m", type=float, default=1e-6)
    options = parser.parse_args()
    by_multigrid(planted_problem(33)[0], options.tolerance_m)  # compiles
    print(f"{'grid':>10}  {'method':<26}{'seconds':>9}{'iterations':>12}{'error m':>11}")
    for size in options.sizes:
        problem, height = planted_problem(size)
        for name, solver in SOLVERS.items():
            if solver is by_direct and size > DIRECT_LIMIT:
                continue
            start = time.perf_counter()
            found, iterations = solver(problem, options.tolerance_m)
            seconds = time.perf_counter() - start
            error = np.abs(found - height[problem.mask]).max()
            print(f"{size:>7} ²   {name:<26}{seconds:>9.3f}{iterations:>12}{error:>11.1e}")
        if size <= POSTERIOR_LIMIT:
            posterior_sigma(planted_problem(33)[0])
            start = time.perf_counter()
            posterior_sigma(problem)
            print(f"{size:>7} ²   {'sigma, exact':<26}{time.perf_counter() - start:>9.3f}")


if __name__ == "__main__":
    main()
