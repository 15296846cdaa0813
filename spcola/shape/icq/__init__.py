"""The implicitly connected quadrilateral (ICQ): six faces of a cube."""

from spcola.shape.icq.template import (
    IcqEdges,
    IcqShape,
    as_icq,
    distinct_vertices,
    first_open_edge,
    icq_directions,
    label_name,
)

__all__ = [
    "IcqEdges",
    "IcqShape",
    "as_icq",
    "distinct_vertices",
    "first_open_edge",
    "icq_directions",
    "label_name",
]
