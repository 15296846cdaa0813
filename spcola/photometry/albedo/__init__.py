"""Albedo of fixed topography from images: [21] for 1 + tz alone."""

from spcola.photometry.albedo.result import AlbedoOutcome, AlbedoSolution
from spcola.photometry.albedo.solve import AlbedoOptions, solve_albedo

__all__ = ["AlbedoOptions", "AlbedoOutcome", "AlbedoSolution", "solve_albedo"]
