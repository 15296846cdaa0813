from .lattices import lattice as lattice
from .similarity import Affine as Affine
from .similarity import Similarity as Similarity
