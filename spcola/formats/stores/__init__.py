"""HDF5 files: layers, names, and a digest that detects damage."""

from spcola.formats.stores.hdf5 import (
    NUMBERS,
    read_layer,
    read_names,
    read_number,
    read_text,
    reading_hdf5,
    replacing_hdf5,
    seal,
    sealed,
    stored,
    stored_names,
)
from spcola.formats.stores.map_store import MapStore

__all__ = [
    "NUMBERS",
    "MapStore",
    "read_layer",
    "read_names",
    "read_number",
    "read_text",
    "reading_hdf5",
    "replacing_hdf5",
    "seal",
    "sealed",
    "stored",
    "stored_names",
]
