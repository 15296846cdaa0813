"""Transforms between frames, directions and lattices of them."""

from spcola.math.directions import lon_lat_deg
from spcola.math.lattices import lattice
from spcola.math.similarity import Affine, Similarity

__all__ = ["Affine", "Similarity", "lattice", "lon_lat_deg"]
