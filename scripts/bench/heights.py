"""Time the solver of energy (A) beside its peers: a table, all measured in this run.

Each case runs in a process of its own: its peak memory is that of the process, the problem
included. The error is the largest distance to the surface that was planted. Data are in single
precision where a grid has more than 2001 points a side.

    python scripts/bench/heights.py [--sizes 99 501 1001] [--tolerance-m 1e-4]
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter
from scipy.sparse.linalg import LinearOperator, cg, spsolve

from spcola.arrays import BoolArray, FloatArray
from spcola.heights import HeightProblem, SolverOptions, relax, solve_heights, solve_many
from spcola.heights.components import find_components
from spcola.heights.graph import normal_matrix

KINDS = ("full", "smooth mask", "rough mask", "blocks 1e6", "edges 1e6")
LIMITS = {"pyamg": 2001, "DCT-CG": 5001, "CHOLMOD": 2001, "SuperLU": 501, "relaxation": 99}
SWEEPS = 4500
MAPLETS = 1000

Solver = Callable[[HeightProblem, float], tuple[FloatArray, int]]


def planted_problem(size: int, kind: str = "rough mask") -> tuple[HeightProblem, FloatArray]:
    """Return a problem whose parts are all constrained (2 % of the heights), and its surface."""
    rng = np.random.default_rng(0)
    real = np.float64 if size <= 2001 else np.float32
    height = 50 * gaussian_filter(rng.standard_normal((size, size), dtype=np.float32), 6)
    mask = planted_mask(size, kind, rng)
    factor = np.ones((size, size), dtype=real)
    if kind == "blocks 1e6":
        row, column = np.indices((size, size), sparse=True)
        factor = 10.0 ** rng.uniform(-3, 3, (-(-size // 16),) * 2)[row // 16, column // 16]
    weights = [np.minimum(factor[:, 1:], factor[:, :-1]), np.minimum(factor[1:], factor[:-1])]
    if kind == "edges 1e6":
        weights = [10 ** rng.uniform(-3, 3, each.shape) for each in weights]
    known = np.where(rng.random((size, size), dtype=np.float32) < 0.02, height, np.nan)
    layers = [np.diff(height, axis=1), np.diff(height, axis=0), *weights, known]
    layers = [np.asarray(each, dtype=real) for each in layers]
    weight = np.ones((size, size), dtype=real)
    problem = HeightProblem(*layers, weight, mask)
    mask &= ~find_components(problem).is_floating
    return HeightProblem(*layers, weight, mask), height


def planted_mask(size: int, kind: str, rng: np.random.Generator) -> BoolArray:
    """64 % of a grid, with wide or narrow pieces; all of it for other kinds."""
    if not kind.endswith("mask"):
        return np.ones((size, size), dtype=bool)
    scale = 4.0 if kind.startswith("rough") else size / 40
    pattern = gaussian_filter(rng.standard_normal((size, size), dtype=np.float32), scale)
    return pattern > np.quantile(pattern, 0.36)


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


def by_cholmod(problem: HeightProblem, _tolerance_m: float) -> tuple[FloatArray, int]:
    factor = import_module("sksparse.cholmod").cholesky(normal_matrix(problem, problem.weight))
    return factor(right_side(problem)), 1


def by_pyamg(problem: HeightProblem, tolerance_m: float) -> tuple[FloatArray, int]:
    matrix = normal_matrix(problem, problem.weight).tocsr()
    right, history = right_side(problem), list[float]()
    solver = import_module("pyamg").ruge_stuben_solver(matrix)
    relative = 0.1 * tolerance_m / float(np.linalg.norm(right))
    height = solver.solve(right, tol=relative, accel="cg", residuals=history)
    return height, len(history) - 1


def by_relaxation(problem: HeightProblem, _tolerance_m: float) -> tuple[FloatArray, int]:
    return relax(problem, sweeps=SWEEPS, seed=0)[problem.mask], SWEEPS


def by_dct(problem: HeightProblem, tolerance_m: float) -> tuple[FloatArray, int]:
    """Conjugate gradients with the whole rectangle's Poisson equation as preconditioner."""
    rows, columns = problem.shape
    y, x = np.arange(rows)[:, None], np.arange(columns)
    eigenvalues = 4 - 2 * np.cos(np.pi * y / rows) - 2 * np.cos(np.pi * x / columns)
    eigenvalues += float(np.mean(problem.weight[problem.mask]))

    def poisson(residual: FloatArray) -> FloatArray:
        whole = np.zeros(problem.shape)
        whole[problem.mask] = residual.ravel()
        transformed = dctn(whole, norm="ortho", workers=-1) / eigenvalues
        return idctn(transformed, norm="ortho", workers=-1)[problem.mask]

    matrix = normal_matrix(problem, problem.weight)
    count = 0

    def counted(_: FloatArray) -> None:
        nonlocal count
        count += 1

    operator = LinearOperator(matrix.shape, matvec=poisson, dtype=np.float64)
    absolute = 0.1 * tolerance_m
    height, _ = cg(matrix, right_side(problem), rtol=0, atol=absolute, M=operator, callback=counted)
    return height, count


SOLVERS: dict[str, Solver] = {
    "spcola": by_multigrid,
    "pyamg": by_pyamg,
    "DCT-CG": by_dct,
    "CHOLMOD": by_cholmod,
    "SuperLU": by_direct,
    "relaxation": by_relaxation,
}
MODULES = {"pyamg": "pyamg", "CHOLMOD": "sksparse"}


def measure(name: str, size: int, kind: str, tolerance_m: float) -> tuple[float, int, float, float]:
    """Return seconds, iterations, largest error (m) and peak memory (GB) of one case."""
    if name == "spcola":
        # Compiles, or loads from the cache: for the precision and the weights of the case.
        by_multigrid(planted_problem(401, kind)[0], tolerance_m)
    problem, height = planted_problem(size, kind)
    if name == "spcola" and size > 2001:
        small, _ = planted_problem(401, kind)
        layers = ("step_x", "step_y", "weight_x", "weight_y", "height", "weight")
        single = (getattr(small, layer).astype(np.float32) for layer in layers)
        by_multigrid(HeightProblem(*single, small.mask), tolerance_m)
    start = time.perf_counter()
    found, iterations = SOLVERS[name](problem, tolerance_m)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    return seconds, iterations, float(np.abs(found - height[problem.mask]).max()), peak


def measure_maplets(count: int, tolerance_m: float) -> float:
    """Return the seconds for that many maplets of 99 × 99, problems already made."""
    problem, _ = planted_problem(99, "full")
    solve_many([problem], options=SolverOptions(tolerance_m=tolerance_m))
    start = time.perf_counter()
    solve_many([problem] * count, options=SolverOptions(tolerance_m=tolerance_m))
    return time.perf_counter() - start


def show_case(name: str, size: int, kind: str, tolerance_m: float) -> float | None:
    """Print one line of the table; return the seconds, if the case was run."""
    label = f"{size:>6} ²  {kind:<12}{name:<12}"
    if size > LIMITS.get(name, size):
        return None
    if name in MODULES and find_spec(MODULES[name]) is None:
        print(f"{label}not installed")
        return None
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        case = pool.apply(measure, (name, size, kind, tolerance_m))
    seconds, iterations, error, peak = case
    print(f"{label}{seconds:>9.2f} s{iterations:>7}{error:>11.1e} m{peak:>8.2f} GB", flush=True)
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the height solver beside its peers.")
    parser.add_argument("--sizes", type=int, nargs="+", default=[99, 501, 1001])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--tolerance-m", type=float, default=1e-4)
    options = parser.parse_args()
    print("grid      problem     solver            time  iter.     error      peak")
    for size in options.sizes:
        for kind in options.kinds:
            taken = {
                name: show_case(name, size, kind, options.tolerance_m)
                for name in (SOLVERS if kind in KINDS[:3] else ("spcola", "pyamg"))
            }
            show_ratios(taken, size)
    seconds = measure_maplets(MAPLETS, options.tolerance_m)
    print(f"{MAPLETS} maplets of 99 × 99: {seconds:.1f} s (bar: 5 s)")


def show_ratios(taken: dict[str, float | None], size: int) -> None:
    """Print how many times faster than its peers the solver was, and the bars."""
    own = taken["spcola"]
    for name, bar in (("pyamg", 5.0), ("DCT-CG", 3.0)):
        other = taken.get(name)
        if own and other:
            print(f"{'':10}{name} / spcola = {other / own:.1f} (bar at 2001²: {bar:.0f})")
    if own and size >= 5001:
        print(f"{'':10}{own:.1f} s (bar: 4 s on two cores, under 2 GB)")


if __name__ == "__main__":
    main()
