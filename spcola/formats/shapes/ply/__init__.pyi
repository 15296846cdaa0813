from .data import read_elements as read_elements
from .header import PlyElement as PlyElement
from .header import PlyHeader as PlyHeader
from .header import parse_header as parse_header
from .mesh import read_ply_mesh as read_ply_mesh
from .mesh import write_ply_mesh as write_ply_mesh
