"""Heights from slopes and constraints, and their uncertainty."""

from spcola.heights.banded import inverse_entries
from spcola.heights.means import MeanConstraints
from spcola.heights.posterior import posterior_sigma
from spcola.heights.problem import HeightProblem
from spcola.heights.solver import HeightSolution, HeightSystem, SolverOptions, solve_heights

__all__ = [
    "HeightProblem",
    "HeightSolution",
    "HeightSystem",
    "MeanConstraints",
    "SolverOptions",
    "inverse_entries",
    "posterior_sigma",
    "solve_heights",
]
