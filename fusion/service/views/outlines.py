"""Where surfaces lie on the body, to be drawn around and clicked."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fusion.service.views.surfaces import LayerCache, SurfaceKind, surface_names
from fusion.service.views.surfaces.cache import state_of
from fusion.service.views.surfaces.opening import BIGMAP_FOLDERS
from fusion.workspace import Workspace, visible_files
from spcola.arrays import AnyArray
from spcola.errors import InvalidValueError
from spcola.formats.maplets import MapParts

__all__ = ["OUTLINED", "outlines", "same_place"]


def outlines(
    workspace: Workspace, kind: SurfaceKind, *, cache: LayerCache | None = None
) -> dict[str, Any]:
    """Return the squares that the surfaces of one `kind` cover.

    Parameters
    ----------
    workspace : Workspace
    kind : SurfaceKind
        One of :data:`OUTLINED`.
    cache : LayerCache, optional

    Returns
    -------
    dict
        The columns `name` (as surfaces are named), `center_m` (N, 3), `axes` (N, 3, 3: Ux, down,
        Uy, right, and Uz), `side_m` and `gsd_m`. Mapolas are in the frame of the lidar.

    Raises
    ------
    InvalidValueError
        If there are no outlines of this kind.
    SpcolaError
        If a file is damaged.
    """
    if kind not in OUTLINED:
        do = f"there are: {', '.join(OUTLINED)}"
        raise InvalidValueError(f"there are no outlines of the kind {kind.value!r}", do=do)
    folder, names = OUTLINED[kind](workspace)
    key = repr(("outlines", str(folder), names, state_of(folder) if names else ""))
    find, columns = (cache or LayerCache()).find, ("name", "center_m", "axes", "side_m", "gsd_m")
    found = {each: find(key, each, lambda: _columns(folder, names), slow=True) for each in columns}
    return {"kind": kind.value, **found}


def _columns(folder: Path, names: list[str]) -> dict[Hashable, AnyArray]:
    """Return the columns of the surfaces `names`, whose files lie in a folder."""
    grids = [MapParts.open(folder / f"{name.partition(':')[0]}.MAP").grid for name in names]
    return {
        "name": np.array(names, dtype=str),
        "center_m": np.array([grid.center for grid in grids]).reshape(-1, 3),
        "axes": np.array([grid.axes for grid in grids]).reshape(-1, 3, 3),
        "side_m": np.array([(grid.size - 1) * grid.gsd for grid in grids]),
        "gsd_m": np.array([grid.gsd for grid in grids]),
    }


def same_place(workspace: Workspace, kind: SurfaceKind, name: str) -> list[tuple[str, str]]:
    """Return kind and name of all surfaces of the same maplet, site or image, itself included.

    These are what is compared: of SPC, of the lidar, of both. Each has a frame of its own.
    """
    place = name.rpartition(":")[0] or name
    if kind is SurfaceKind.PAIR:
        kinds: tuple[SurfaceKind, ...] = (kind,)
    else:
        kinds = tuple(each for each in SurfaceKind if each is not SurfaceKind.PAIR)
    return [
        (each.value, other)
        for each in kinds
        for other in surface_names(workspace, each)
        if (other.rpartition(":")[0] or other) == place
    ]


def _maplets(workspace: Workspace) -> tuple[Path, list[str]]:
    return workspace.home / "MAPFILES", surface_names(workspace, SurfaceKind.MAPLET)


def _in_folder(folder: str, part: str = "") -> Callable[[Workspace], tuple[Path, list[str]]]:
    """Return what gives a folder, and the names of the surfaces of its .MAP files."""

    def listed(workspace: Workspace) -> tuple[Path, list[str]]:
        place = workspace.home / folder
        return place, sorted(f"{path.stem}{part}" for path in visible_files(place, ".MAP"))

    return listed


OUTLINED: Mapping[SurfaceKind, Callable[[Workspace], tuple[Path, list[str]]]] = {
    SurfaceKind.MAPLET: _maplets,
    SurfaceKind.MAPOLA: _in_folder("mapolas"),
    SurfaceKind.FUSED: _in_folder("fused"),
    SurfaceKind.BIGMAP: _in_folder(BIGMAP_FOLDERS["fused"], ":fused"),
}
"""Kinds of surfaces with outlines, and what gives the folder of their files, and their names."""
