"""States of images in and out: .SUM and .NOM from SPICE kernels, kernels from .SUM."""

from fusion.stages.states.kernels import export_kernels
from fusion.stages.states.nominal import NominalOptions, compare_with_kernels, make_sumfiles
from fusion.stages.states.source import SourceOptions, SpiceSource, spice_source

__all__ = [
    "NominalOptions",
    "SourceOptions",
    "SpiceSource",
    "compare_with_kernels",
    "export_kernels",
    "make_sumfiles",
    "spice_source",
]
