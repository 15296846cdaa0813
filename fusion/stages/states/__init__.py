"""States of images in and out: .SUM and .NOM from kernels or a table, kernels from .SUM."""

from fusion.stages.states.kernels import export_kernels
from fusion.stages.states.nominal import (
    FoundStates,
    NominalOptions,
    compare_with_solution,
    make_sumfiles,
    states_by_kernels,
    states_by_poses,
    write_states,
)
from fusion.stages.states.source import SourceOptions

__all__ = [
    "FoundStates",
    "NominalOptions",
    "SourceOptions",
    "compare_with_solution",
    "export_kernels",
    "make_sumfiles",
    "states_by_kernels",
    "states_by_poses",
    "write_states",
]
