"""Change of the scale of an SPC solution: all lengths times one factor, and images still fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from spcola.camera import SpcImage
from spcola.camera.linescan import LineScan, LineScanImage
from spcola.control.landmark import Landmark
from spcola.grids import Maplet, MapletGrid
from spcola.navigation import NominalState
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape

Part = TypeVar(
    "Part", MapletGrid, Maplet, Landmark, SpcImage, NominalState, Mesh, IcqShape, LineScan,
    LineScanImage,
)  # fmt: skip

# The lengths (and speeds) of each part of a solution. Albedo, camera, axes, overlaps in grid steps
# and the layer of a shape have no scale.
_LENGTHS: dict[type[Any], tuple[str, ...]] = {
    MapletGrid: ("center", "gsd"),
    Maplet: ("height", "sigma", "center_sigma"),
    Landmark: ("sigma", "prior_sigma"),
    SpcImage: ("scobj", "scobj_sigma"),
    NominalState: ("velocity", "scobj", "scobj_sigma"),
    Mesh: ("vertices",),
    IcqShape: ("vertices",),
    LineScan: ("positions",),
    LineScanImage: (),
}


def scaled(part: Part, factor: float) -> Part:
    """Return a part of a solution with all its lengths multiplied by `factor`."""
    names = next(names for kind, names in _LENGTHS.items() if isinstance(part, kind))
    lengths: dict[str, Any] = {name: factor * getattr(part, name) for name in names}
    if isinstance(part, (Maplet, Landmark)):
        lengths["grid"] = scaled(part.grid, factor)
    if isinstance(part, LineScanImage):
        lengths["scan"] = scaled(part.scan, factor)
    return replace(part, **lengths)
