"""The adjustment of scans on disk: one HDF5, whole or not at all."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from lidar.adjustment import RigidArcs, ScanAdjustment, ScanErrorSizes
from spcola.arrays import AnyArray
from spcola.errors import InvalidValueError
from spcola.formats.hdf5 import (
    read_layer,
    read_names,
    read_number,
    reading_hdf5,
    replacing_hdf5,
    stored,
)

ADJUSTMENT_HDF5 = "adjustment.h5"
"""Name of the file in a folder of mapolas."""

_FORMAT = "spcola scan adjustment 2"
_ARCS = ("center", "scan", "day")
_LAYERS = ("displacement", "covariance", "misfit", "cells")
# Largest numbers, metres and radians or their squares: no adjustment of a small body comes near.
_LARGEST = 1e12
_ROUNDING = 1e-6
_WHOLE = {"scan", "day"}
_SIZES = tuple(field.name for field in fields(ScanErrorSizes))


def write_adjustment(path: str | Path, adjustment: ScanAdjustment) -> None:
    """Write an `adjustment` to `path`: metres and radians, one row a scan.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    with replacing_hdf5(path) as file:
        file.attrs["format"] = stored(_FORMAT)
        file["names"] = stored(adjustment.names)
        for layer in _ARCS:
            file[layer] = getattr(adjustment.arcs, layer)
        for layer in _LAYERS:
            file[layer] = getattr(adjustment, layer)
        file.attrs["step_m"] = adjustment.step_m
        for size in _SIZES:
            file.attrs[size] = getattr(adjustment.sizes, size)


def read_adjustment(path: str | Path) -> ScanAdjustment:
    """Read the adjustment at `path`.

    Raises
    ------
    FormatError
        If the file cannot be opened, is something else, or damaged.
    """
    with reading_hdf5(path, _FORMAT, "is damaged", "make the mapolas again") as file:
        count = len(read_layer(file, "scan", (None,)))
        layers = {name: read_layer(file, name, shape) for name, shape in _shapes(count).items()}
        _check_numbers(layers)
        layers |= {name: layers[name].astype(np.float64) for name in layers.keys() - _WHOLE}
        sizes = {size: read_number(file, size) for size in _SIZES}
        for size, value in sizes.items():
            if not 0.0 <= value < np.inf:
                raise InvalidValueError(f"is {value:g}", size)
        return ScanAdjustment(
            names=tuple(read_names(file, "names", count)),
            arcs=RigidArcs(*(layers.pop(layer) for layer in _ARCS)),
            sizes=ScanErrorSizes(**sizes),
            step_m=read_number(file, "step_m"),
            **layers,
        )


def _shapes(count: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the layers of an adjustment of `count` scans."""
    one = (count,)
    return {
        "center": (count, 3),
        "scan": one,
        "day": one,
        "displacement": (count, 6),
        "covariance": (6 * count, 6 * count),
        "misfit": one,
        "cells": one,
    }


def _check_numbers(layers: dict[str, AnyArray]) -> None:
    """Refuse numbers that no adjustment has: their eigenvalues might not converge."""
    for name in ("center", "displacement", "covariance"):
        largest = float(np.max(np.abs(layers[name]), initial=0.0))
        if not largest < _LARGEST:
            raise InvalidValueError(f"holds {largest:g}", name)
    covariance = layers["covariance"]
    with np.errstate(all="ignore"):
        sigmas = np.sqrt(np.diag(covariance).astype(np.float64))
        # As it is decomposed later: NaN where a variance is invalid.
        correlation = covariance / np.outer(sigmas, sigmas)
        sound = np.abs(correlation) <= 1.0 + _ROUNDING
        sound &= np.abs(correlation - correlation.T) <= _ROUNDING
    if not np.all(sound):
        raise InvalidValueError("is no covariance", "covariance")
    for name in _WHOLE:
        if layers[name].dtype.kind == "f":
            raise InvalidValueError("holds no whole numbers", name)
