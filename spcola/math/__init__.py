"""Transforms between frames, directions and lattices of them."""

from spcola.math.directions import local_axes, lon_lat_deg
from spcola.math.lattices import lattice
from spcola.math.similarity import Affine, Similarity, similarity_between

__all__ = ["Affine", "Similarity", "lattice", "local_axes", "lon_lat_deg", "similarity_between"]
