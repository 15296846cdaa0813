"""Transforms between frames, and lattices of directions."""

from spcola.math.lattices import lattice
from spcola.math.similarity import Affine, Similarity

__all__ = ["Affine", "Similarity", "lattice"]
