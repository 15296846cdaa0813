"""Fused maplets and bigmaps, and their files."""

from fusion.fusing.maplets.bigmap import fused_bigmap
from fusion.fusing.maplets.maplet import FusedMaplet, Source
from fusion.fusing.maplets.store import (
    FUSED_HDF5,
    FUSED_STORE,
    fused_names,
    read_fused,
    write_fused,
)

__all__ = [
    "FUSED_HDF5",
    "FUSED_STORE",
    "FusedMaplet",
    "Source",
    "fused_bigmap",
    "fused_names",
    "read_fused",
    "write_fused",
]
