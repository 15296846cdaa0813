"""Heights from slopes and constraints, and their uncertainty."""

from spcola.heights.means import MeanConstraints
from spcola.heights.posterior import posterior_sigma
from spcola.heights.problem import HeightProblem
from spcola.heights.relaxation import relax
from spcola.heights.slopes import STEPS_ALIKE, slopes_of, steps_from_slopes
from spcola.heights.smoothing import multiply
from spcola.heights.solver import HeightSolution, HeightSystem, SolverOptions, solve_heights

__all__ = [
    "STEPS_ALIKE",
    "HeightProblem",
    "HeightSolution",
    "HeightSystem",
    "MeanConstraints",
    "SolverOptions",
    "multiply",
    "posterior_sigma",
    "relax",
    "slopes_of",
    "solve_heights",
    "steps_from_slopes",
]
