"""The adjustment of scans on disk: one HDF5, whole or not at all."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from lidar.adjustment import ScanAdjustment
from lidar.nodes import ErrorSizes, Nodes
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.hdf5 import DAMAGE, replacing_hdf5

ADJUSTMENT_HDF5 = "adjustment.h5"
"""Name of the file in a folder of mapolas."""

_FORMAT = "spcola scan adjustment 2"
_NODES = ("center", "scan", "day")
_LAYERS = ("displacement", "covariance", "misfit", "cells")
_SIZES = tuple(field.name for field in fields(ErrorSizes))


def write_adjustment(path: str | Path, adjustment: ScanAdjustment) -> None:
    """Write an adjustment: metres and radians, one row a scan.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    with replacing_hdf5(path) as file:
        file.attrs["format"] = _FORMAT
        file["names"] = np.array(list(adjustment.names), dtype=h5py.string_dtype())
        for layer in _NODES:
            file[layer] = getattr(adjustment.nodes, layer)
        for layer in _LAYERS:
            file[layer] = getattr(adjustment, layer)
        file.attrs["step_m"] = adjustment.step_m
        for size in _SIZES:
            file.attrs[size] = getattr(adjustment.sizes, size)


def read_adjustment(path: str | Path) -> ScanAdjustment:
    """Read an adjustment.

    Raises
    ------
    WorkspaceError
        If the file cannot be opened.
    FormatError
        If it is something else, or damaged.
    """
    path, again = Path(path), "make the mapolas again"
    try:
        file = h5py.File(path, "r")
        form = file.attrs.get("format")
    except DAMAGE as error:
        raise WorkspaceError("cannot be read as HDF5", path, again) from error
    with file:
        if form != _FORMAT:
            raise FormatError(f"is not {_FORMAT!r}", path, again)
        try:
            layers: dict[str, Any] = {layer: file[layer][:] for layer in _LAYERS}
            sizes = ErrorSizes(*(float(file.attrs[size]) for size in _SIZES))
            return ScanAdjustment(
                names=tuple(file["names"].asstr()[:]),
                nodes=Nodes(*(file[layer][:] for layer in _NODES)),
                sizes=sizes,
                step_m=float(file.attrs["step_m"]),
                **layers,
            )
        except (*DAMAGE, InvalidValueError) as error:
            raise FormatError(f"is damaged ({error})", path, again) from error
