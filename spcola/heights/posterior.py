"""Uncertainty of the heights: the diagonal of the inverse normal matrix of energy (A)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spcola.arrays import FloatArray, check_shape
from spcola.errors import SettingsError
from spcola.heights.banded import BandedFactor, band_width
from spcola.heights.means import MeanConstraints
from spcola.heights.problem import HeightProblem
from spcola.heights.solver import HeightSystem, SolverOptions

Method = Literal["auto", "exact", "patches", "probing"]

_EXACT_LIMIT = 60_000_000
"""Elements of the band (points × columns) up to which the exact method is used: 0.5 GB."""


@dataclass(frozen=True)
class PosteriorOptions:
    """How large grids are divided and sampled.

    Parameters
    ----------
    core : int
        Side of the squares whose sigma comes from one window, grid points.
    margin : int
        Width of the window around its core, grid points.
    samples : int
        Random surfaces of the method "probing"; their part of sigma has an error of 1/√(2 samples).
    seed : int
        Seed of the random surfaces.

    Raises
    ------
    SettingsError
        If a number is out of range.
    """

    core: int = 48
    margin: int = 24
    samples: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("core", 1), ("margin", 1), ("samples", 2)):
            if getattr(self, name) < least:
                raise SettingsError(f"must be at least {least}, not {getattr(self, name)}", name)


def posterior_sigma(
    problem: HeightProblem,
    *,
    method: Method = "auto",
    weight: FloatArray | None = None,
    noise_level: float = 1.0,
    options: PosteriorOptions | None = None,
) -> FloatArray:
    """Return one standard deviation of each height of the minimiser of energy (A).

    Parameters
    ----------
    problem : HeightProblem
        The problem that was solved.
    method : {"auto", "exact", "patches", "probing"}
        "auto" is "exact" where its band of points × columns fits into 0.5 GB (391 × 391 points,
        fewer with means over wide areas), and "patches" where it does not. "exact" factors the
        whole matrix. "patches" does so in overlapping windows and ignores all outside: never below
        the exact sigma, and close to it if the margin exceeds the distance over which a constraint
        acts, 1/√(w_c/w_e × share of constrained points) steps. "probing" adds the variance that
        the surroundings of each window cause, estimated from random surfaces of the whole problem:
        right for any weights, except for the scatter of the samples.
    weight : (R, C) ndarray, optional
        Constraint weights that replace the problem's, 1/m²: those of a robust loss
        (``HeightSolution.constraint_weight``).
    noise_level : float
        Factor on sigma (such as √ of the reduced χ²), 1 if the weights are inverse variances.
    options : PosteriorOptions, optional
        Windows and samples.

    Returns
    -------
    (R, C) ndarray
        Metres; NaN outside the mask and on floating parts, whose height nothing determines.

    Raises
    ------
    SettingsError
        If the method is unknown, the noise level not positive, or the grid too large for "exact".
    """
    if not (np.isfinite(noise_level) and noise_level > 0):
        raise SettingsError(f"must be positive, not {noise_level}", "noise_level")
    bare = _without_data(problem, problem.weight if weight is None else weight)
    chosen = PosteriorOptions() if options is None else options
    if method == "auto":
        method = "exact" if _fits(_upright(bare)) else "patches"
    if method == "exact":
        variance = _exact_variance(bare)
    elif method == "patches":
        variance = _patched_variance(bare, chosen)
    elif method == "probing":
        variance = _probed_variance(bare, chosen)
    else:
        raise SettingsError(f"is {method!r}", "method", "choose auto, exact, patches or probing")
    return noise_level * np.sqrt(variance)


def _without_data(problem: HeightProblem, weight: FloatArray) -> HeightProblem:
    """Return the problem with all steps and heights 0: sigma depends on the weights only."""
    check_shape(weight, problem.shape, "weight")
    return replace(
        problem,
        step_x=np.zeros(problem.step_x.shape),
        step_y=np.zeros(problem.step_y.shape),
        height=np.zeros(problem.shape),
        weight=np.where(problem.weight > 0, weight, 0.0),
    )


def _exact_variance(problem: HeightProblem) -> FloatArray:
    turned = _upright(problem)
    if not _fits(turned):
        rows, columns = problem.shape
        wide = " with means over such wide areas" if problem.means is not None else ""
        raise SettingsError(
            f"a grid of {rows} × {columns}{wide} is too large for 'exact'",
            "method",
            "choose patches",
        )
    variance = BandedFactor(turned).variance()
    return variance if turned is problem else variance.T


def _upright(problem: HeightProblem) -> HeightProblem:
    """Return the problem with no more columns than rows, for the narrowest band."""
    rows, columns = problem.shape
    return problem if columns <= rows else _transposed(problem)


def _fits(problem: HeightProblem) -> bool:
    """Return whether the band is within the limit of the exact method."""
    return problem.mask.size * band_width(problem) <= _EXACT_LIMIT


def _transposed(problem: HeightProblem) -> HeightProblem:
    return HeightProblem(
        problem.step_y.T,
        problem.step_x.T,
        problem.weight_y.T,
        problem.weight_x.T,
        problem.height.T,
        problem.weight.T,
        problem.mask.T,
        None if problem.means is None else problem.means.transposed(problem.shape),
    )


@dataclass(frozen=True)
class _Window:
    """A core and its surroundings, as slices of the whole grid."""

    rows: slice
    columns: slice
    core_rows: slice
    core_columns: slice

    @property
    def whole(self) -> tuple[slice, slice]:
        """Core and surroundings."""
        return (self.rows, self.columns)

    @property
    def core(self) -> tuple[slice, slice]:
        """The core alone."""
        return (self.core_rows, self.core_columns)

    @property
    def core_inside(self) -> tuple[slice, slice]:
        """The core as slices of the window."""
        r, c = self.rows.start, self.columns.start
        return (
            slice(self.core_rows.start - r, self.core_rows.stop - r),
            slice(self.core_columns.start - c, self.core_columns.stop - c),
        )


def _windows(shape: tuple[int, int], options: PosteriorOptions) -> Iterator[_Window]:
    """Yield windows whose cores tile the grid."""

    def spans(size: int) -> Iterator[tuple[slice, slice]]:
        for first in range(0, size, options.core):
            last = min(first + options.core, size)
            low, high = max(0, first - options.margin), min(size, last + options.margin)
            yield slice(low, high), slice(first, last)

    for rows, core_rows in spans(shape[0]):
        for columns, core_columns in spans(shape[1]):
            yield _Window(rows, columns, core_rows, core_columns)


def _patched_variance(problem: HeightProblem, options: PosteriorOptions) -> FloatArray:
    """Variance from windows cut out of the problem: edges across their borders are dropped."""
    variance = np.full(problem.shape, np.nan)
    for window in _windows(problem.shape, options):
        part = _cut(problem, window, problem.weight[window.whole], whole=True)
        variance[window.core] = BandedFactor(part).variance()[window.core_inside]
    return variance


def _probed_variance(problem: HeightProblem, options: PosteriorOptions) -> FloatArray:
    """Variance within each window given its surroundings, plus that of its conditional mean.

    The law of total variance: the first term is exact, the second is estimated from random
    surfaces with the covariance of the whole problem (Rao–Blackwell estimate).
    """
    surfaces = _random_surfaces(problem, options)
    variance = np.full(problem.shape, np.nan)
    for window in _windows(problem.shape, options):
        outward = _outward_edges(problem, window)
        ground = sum((weight for weight, _, _ in outward), problem.weight[window.whole])
        factor = BandedFactor(_cut(problem, window, ground, whole=False))
        right = np.zeros((*ground.shape, options.samples))
        for weight, down, across in outward:
            r, c = np.nonzero(weight)
            beyond = surfaces[r + window.rows.start + down, c + window.columns.start + across]
            right[r, c] += weight[r, c, None] * np.nan_to_num(beyond)
        if problem.means is not None:
            right += _pull_of_means(problem.means, window, surfaces)
        mean = factor.solve(right)[window.core_inside]
        within = factor.variance()[window.core_inside]
        variance[window.core] = within + np.mean(mean**2, axis=-1)
    variance[np.isnan(surfaces[..., 0])] = np.nan
    return variance


def _pull_of_means(means: MeanConstraints, window: _Window, surfaces: FloatArray) -> FloatArray:
    """Contribution to the residual of means across a window's border; `surfaces` (R, C, S)."""
    r, c = np.divmod(means.points, surfaces.shape[1])
    inside = (r >= window.rows.start) & (r < window.rows.stop)
    inside &= (c >= window.columns.start) & (c < window.columns.stop)
    across = np.isin(means.owner, means.owner[inside]) & ~inside
    beyond = np.zeros((len(means.height), surfaces.shape[2]))
    outer = means.share[across, None] * np.nan_to_num(surfaces[r[across], c[across]])
    np.add.at(beyond, means.owner[across], outer)
    chosen = inside & np.isin(means.owner, means.owner[across])
    owner = means.owner[chosen]
    pull = np.zeros((*surfaces[window.whole].shape[:2], surfaces.shape[2]))
    place = (r[chosen] - window.rows.start, c[chosen] - window.columns.start)
    np.add.at(pull, place, -(means.weight[owner] * means.share[chosen])[:, None] * beyond[owner])
    return pull


def _cut(
    problem: HeightProblem, window: _Window, weight: FloatArray, *, whole: bool
) -> HeightProblem:
    """Return the problem inside a window, with the given constraint weights there.

    Means that reach out of it are dropped if `whole`, else fixed outside.
    """
    mask = problem.mask[window.whole]
    rows, columns = mask.shape
    across = (window.rows, slice(window.columns.start, window.columns.stop - 1))
    down = (slice(window.rows.start, window.rows.stop - 1), window.columns)
    return HeightProblem(
        np.zeros((rows, columns - 1)),
        np.zeros((rows - 1, columns)),
        problem.weight_x[across],
        problem.weight_y[down],
        np.zeros(mask.shape),
        weight,
        mask,
        problem.means
        and problem.means.inside(window.rows, window.columns, problem.shape[1], whole=whole),
    )


def _outward_edges(problem: HeightProblem, window: _Window) -> list[tuple[FloatArray, int, int]]:
    """Weights of the edges that leave a window, with the step (rows, columns) to their far end."""
    size = problem.mask[window.whole].shape
    edges: list[tuple[FloatArray, int, int]] = []

    def leave(place: tuple[slice | int, slice | int], values: FloatArray, *step: int) -> None:
        weight = np.zeros(size)
        weight[place] = values
        edges.append((weight, step[0], step[1]))

    rows, columns, every = window.rows, window.columns, slice(None)
    if columns.start > 0:
        leave((every, 0), problem.weight_x[rows, columns.start - 1], 0, -1)
    if columns.stop < problem.shape[1]:
        leave((every, -1), problem.weight_x[rows, columns.stop - 1], 0, 1)
    if rows.start > 0:
        leave((0, every), problem.weight_y[rows.start - 1, columns], -1, 0)
    if rows.stop < problem.shape[0]:
        leave((-1, every), problem.weight_y[rows.stop - 1, columns], 1, 0)
    return edges


def _random_surfaces(problem: HeightProblem, options: PosteriorOptions) -> FloatArray:
    """Draw surfaces (R, C, S), metres, whose covariance is the inverse normal matrix.

    They are the solutions for pure noise of the stated weights in all steps and constraints.
    """
    rng = np.random.default_rng(options.seed)
    surfaces = np.empty((*problem.shape, options.samples))
    sigma_x, sigma_y, sigma = (
        np.divide(1.0, np.sqrt(w), out=np.zeros(w.shape), where=w > 0)
        for w in (problem.weight_x, problem.weight_y, problem.weight)
    )
    # Sampling errors are per cents: a thousandth of the smallest local sigma suffices.
    stiffest = max(float(w.max(initial=0.0)) for w in (problem.weight_x, problem.weight_y))
    stiffest = max(stiffest, float(problem.weight.max(initial=0.0)), np.finfo(float).tiny)
    exact_enough = SolverOptions(tolerance_m=1e-3 / np.sqrt(stiffest), floating="unknown")
    system = HeightSystem(problem)
    for k in range(options.samples):
        mean_noise = None
        if problem.means is not None:
            weights = problem.means.weight
            mean_noise = rng.normal(size=weights.shape) / np.sqrt(weights)
        noise = problem.with_data(
            sigma_x * rng.normal(size=sigma_x.shape),
            sigma_y * rng.normal(size=sigma_y.shape),
            sigma * rng.normal(size=sigma.shape),
            mean_height=mean_noise,
        )
        surfaces[..., k] = system.solve(noise, options=exact_enough).height
    return surfaces
