"""Versions of the SPC solution of a workspace, each made from another."""

from fusion.pipeline.solutions.export import export_solution
from fusion.pipeline.solutions.making import MadeBy, making_solution, solution_files
from fusion.pipeline.solutions.solutions import (
    free_name,
    lineage,
    remove_solution,
    solutions_of,
    use_solution,
)

__all__ = [
    "MadeBy",
    "export_solution",
    "free_name",
    "lineage",
    "making_solution",
    "remove_solution",
    "solution_files",
    "solutions_of",
    "use_solution",
]
