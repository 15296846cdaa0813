"""Time and memory of the solver of energy (A) and its peers, all measured in this run.

Each case runs in a separate process: its peak memory is that of the process while it solves,
with interpreter and problem (these alone are the last column). The error is the largest distance
to the planted surface, which is the exact solution; on small grids the distance to a direct
solution is given too. Data are in single precision on grids of more than 2001 points a side,
unless `--double`.

    python scripts/bench/heights.py [--sizes 99 501] [--kinds full] [--tolerance-m 1e-4]
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import LinearOperator, cg, spsolve

from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import usable_threads
from spcola.heights import HeightProblem, SolverOptions, solve_heights
from spcola.heights.components import find_components
from spcola.heights.graph import normal_matrix
from spcola.heights.relaxation import relax

KINDS = ("full", "few heights", "smooth mask", "rough mask", "blocks 1e6", "edges 1e6")
SIZES = (99, 501, 1001, 2001, 5001)
MOST_POINTS = {"edges 1e6": 2001}
LIMITS = {"pyamg": 2001, "DCT-CG": 5001, "CHOLMOD": 2001, "SuperLU": 501, "relaxation": 99}
SWEEPS = 4500
MAPLETS = 1000
PEER_MAPLETS = 50

Solver = Callable[[HeightProblem, float], tuple[FloatArray, int]]


class Case(NamedTuple):
    """Result of one solver on one problem: seconds, metres, gigabytes."""

    seconds: float
    iterations: int
    error: float
    peak: float
    before: float
    height: FloatArray | None


def planted_surface(size: int, rng: np.random.Generator) -> FloatArray:
    return 50 * gaussian_filter(rng.standard_normal((size, size), dtype=np.float32), 6)


def planted_problem(size: int, kind: str, *, double: bool) -> HeightProblem:
    """Return a problem with constraints in each part: 2 % of the heights, or 20 in all."""
    rng = np.random.default_rng(0)
    real = np.float64 if double else np.float32
    height = planted_surface(size, rng)
    mask = planted_mask(size, kind, rng)
    factor = np.ones((size, size), dtype=real)
    if kind == "blocks 1e6":
        row, column = np.indices((size, size), sparse=True)
        factor = 10.0 ** rng.uniform(-3, 3, (-(-size // 16),) * 2)[row // 16, column // 16]
    weights = [np.minimum(factor[:, 1:], factor[:, :-1]), np.minimum(factor[1:], factor[:-1])]
    if kind == "edges 1e6":
        weights = [10 ** rng.uniform(-3, 3, each.shape) for each in weights]
    share = 20 / size**2 if kind == "few heights" else 0.02
    known = np.where(rng.random((size, size), dtype=np.float32) < share, height, np.nan)
    known[size // 2, size // 2] = height[size // 2, size // 2]
    layers = [np.diff(height, axis=1), np.diff(height, axis=0), *weights, known]
    layers = [np.asarray(each, dtype=real) for each in layers]
    weight = np.ones((size, size), dtype=real)
    problem = HeightProblem(*layers, weight, mask)
    mask &= ~find_components(problem).is_floating
    return HeightProblem(*layers, weight, mask)


def planted_mask(size: int, kind: str, rng: np.random.Generator) -> BoolArray:
    """Return a mask of 64 % of a grid, in wide or narrow pieces; all of it for other kinds."""
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
    return solution.height, solution.iterations


def by_direct(problem: HeightProblem, _tolerance_m: float) -> tuple[FloatArray, int]:
    matrix = normal_matrix(problem, problem.weight)
    return spsolve(matrix, right_side(problem), permc_spec="MMD_AT_PLUS_A"), 1


def by_cholmod(problem: HeightProblem, _tolerance_m: float) -> tuple[FloatArray, int]:
    matrix = csc_matrix(normal_matrix(problem, problem.weight).astype(np.float64))
    matrix.sort_indices()
    factor = import_module("sksparse_minimal").SparseCholesky(matrix)
    return factor.solve_A(right_side(problem)), 1


def by_pyamg(problem: HeightProblem, tolerance_m: float) -> tuple[FloatArray, int]:
    matrix = normal_matrix(problem, problem.weight).tocsr()
    right, history = right_side(problem), list[float]()
    solver = import_module("pyamg").ruge_stuben_solver(matrix)
    relative = 0.1 * tolerance_m / float(np.linalg.norm(right))
    height = solver.solve(right, tol=relative, accel="cg", residuals=history)
    return height, len(history) - 1


def by_relaxation(problem: HeightProblem, _tolerance_m: float) -> tuple[FloatArray, int]:
    return relax(problem, sweeps=SWEEPS, seed=0), SWEEPS


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
MODULES = {"pyamg": "pyamg", "CHOLMOD": "sksparse_minimal"}
"""Optional packages of the peers (CHOLMOD is in the package sksparse-minimal)."""


def warm_up(kind: str, double: bool, tolerance_m: float) -> None:
    """Compile the kernels of the case, or load them from the cache, with small similar problems."""
    by_multigrid(planted_problem(401, kind, double=double), tolerance_m)
    for islands in (2, 16):
        by_multigrid(loose_islands(islands, double=double), tolerance_m)


def loose_islands(islands: int, *, double: bool) -> HeightProblem:
    """Return separate squares of 9 × 9 points with one weak height each."""
    size = 10 * islands
    real = np.float64 if double else np.float32
    mask = np.zeros((size, size), dtype=bool)
    mask.reshape(islands, 10, islands, 10)[:, 1:, :, 1:] = True
    height = np.full((size, size), np.nan, dtype=real)
    height[5::10, 5::10] = 1.0
    along, down = np.ones((size, size - 1), dtype=real), np.ones((size - 1, size), dtype=real)
    weight = np.full((size, size), 1e-2, dtype=real)
    return HeightProblem(0 * along, 0 * down, along, down, height, weight, mask)


def measure(name: str, size: int, kind: str, double: bool, tolerance_m: float) -> Case:
    """Solve one problem with one solver."""
    if name == "spcola":
        warm_up(kind, double, tolerance_m)
    problem = planted_problem(size, kind, double=double)
    before = forget_peak()
    start = time.perf_counter()
    found, iterations = SOLVERS[name](problem, tolerance_m)
    seconds = time.perf_counter() - start
    peak = peak_memory()
    truth = planted_surface(size, np.random.default_rng(0))[problem.mask]
    if found.ndim == 2:
        found = found[problem.mask]
    error = float(np.abs(found - truth).max())
    kept = found if size <= LIMITS["SuperLU"] else None
    return Case(seconds, iterations, error, peak, before, kept)


def forget_peak() -> float:
    """Reset the peak to the memory in use now (on Linux only); return it, GB."""
    clear = Path("/proc/self/clear_refs")
    if clear.exists():
        clear.write_text("5")
    return peak_memory()


def peak_memory() -> float:
    """Return the peak memory of the process, GB."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9


def apart(task: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of `task`, run in a separate process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(task, arguments)


def measure_maplets(tolerance_m: float) -> dict[str, float]:
    """Return the seconds of each solver for 1000 maplets of 99 × 99, without making the problems.

    Peers solve fewer, one after the other; their time is scaled.
    """
    problem = planted_problem(99, "full", double=True)
    options = SolverOptions(tolerance_m=tolerance_m, threads=1)
    solve_heights(problem, options=options)
    start = time.perf_counter()
    with ThreadPoolExecutor(usable_threads()) as pool:
        list(pool.map(lambda one: solve_heights(one, options=options), [problem] * MAPLETS))
    taken = {"spcola": time.perf_counter() - start}
    for name in ("pyamg", "SuperLU", "CHOLMOD"):
        if name in MODULES and find_spec(MODULES[name]) is None:
            continue
        SOLVERS[name](problem, tolerance_m)
        start = time.perf_counter()
        for _ in range(PEER_MAPLETS):
            SOLVERS[name](problem, tolerance_m)
        taken[name] = (time.perf_counter() - start) * MAPLETS / PEER_MAPLETS
    return taken


def show_case(name: str, size: int, kind: str, double: bool, tolerance_m: float) -> Case | None:
    """Print one line of the table; return the case, if it was run."""
    label = f"{size:>6} ²  {kind:<12}{name:<12}"
    if size > LIMITS.get(name, size):
        return None
    if name in MODULES and find_spec(MODULES[name]) is None:
        print(f"{label}not installed")
        return None
    if name == "spcola":
        # In an earlier process: the compiler's memory is not the solver's.
        apart(warm_up, kind, double, tolerance_m)
    case: Case = apart(measure, name, size, kind, double, tolerance_m)
    print(
        f"{label}{case.seconds:>9.2f} s{case.iterations:>7}{case.error:>11.1e} m"
        f"{case.peak:>8.2f} GB{case.before:>8.2f} GB",
        flush=True,
    )
    return case


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the height solver and its peers.")
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES))
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=SOLVERS)
    parser.add_argument("--tolerance-m", type=float, default=1e-4)
    parser.add_argument("--double", action="store_true", help="double precision at every size")
    options = parser.parse_args()
    print("grid      problem     solver            time  iter.     error        peak     before")
    for size in options.sizes:
        for kind in options.kinds:
            if size > MOST_POINTS.get(kind, size):
                continue
            peers = SOLVERS if not kind.endswith("1e6") else ("spcola", "pyamg", "SuperLU")
            cases = {
                name: show_case(
                    name, size, kind, options.double or size <= 2001, options.tolerance_m
                )
                for name in options.solvers
                if name in peers
            }
            show_ratios({name: case for name, case in cases.items() if case}, size)
    taken = measure_maplets(options.tolerance_m)
    print(f"{MAPLETS} maplets of 99 × 99: {taken.pop('spcola'):.1f} s (bar: 5 s on two cores)")
    for name, seconds in taken.items():
        print(f"{'':10}{name}: {seconds:.0f} s (one core, scaled from {PEER_MAPLETS})")


def show_ratios(cases: dict[str, Case], size: int) -> None:
    """Print the speed relative to peers, and the bars."""
    own = cases.get("spcola")
    if own is None:
        return
    for name, bar in (("pyamg", 5.0), ("DCT-CG", 3.0)):
        if name in cases:
            ratio = cases[name].seconds / own.seconds
            print(f"{'':10}{name} / spcola = {ratio:.1f} (bar at 2001²: {bar:.0f})")
    direct = cases.get("SuperLU")
    if direct is not None and own.height is not None and direct.height is not None:
        far = np.abs(own.height - direct.height).max()
        print(f"{'':10}largest distance to the direct solution: {far:.1e} m")
    if size >= 5001:
        print(f"{'':10}{own.seconds:.1f} s, {own.peak:.2f} GB (bar: 4 s on two cores, 2 GB)")


if __name__ == "__main__":
    main()
