"""Surfaces from slopes and heights: energy (A), its solver, its uncertainty."""

from spcola.heights.means import MeanConstraints
from spcola.heights.posterior import PosteriorOptions, posterior_sigma
from spcola.heights.problem import HeightProblem
from spcola.heights.relaxation import relax
from spcola.heights.slopes import slopes_of, steps_from_slopes
from spcola.heights.solver import (
    HeightSolution,
    HeightSystem,
    SolverOptions,
    solve_heights,
    solve_many,
)

__all__ = [
    "HeightProblem",
    "HeightSolution",
    "HeightSystem",
    "MeanConstraints",
    "PosteriorOptions",
    "SolverOptions",
    "posterior_sigma",
    "relax",
    "slopes_of",
    "solve_heights",
    "solve_many",
    "steps_from_slopes",
]
