"""Models to assess: those of a workspace, and those in files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from fusion.fusing.maplets import FUSED_HDF5, fused_names, read_fused
from fusion.inspection import read_terrain
from fusion.registration.results import mapola_registrations, transform_of
from fusion.truth.assessment.model import Frame, MapletModel, MeshModel, Model
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError
from spcola.formats.maplets import read_maplet
from spcola.grids import Maplet
from spcola.shape.icq import IcqShape

_BIGMAPS = (
    ("", "bigmaps of fused maplets"),
    ("maplets", "bigmaps of SPC maplets"),
    ("returns", "bigmaps of lidar returns"),
)


def workspace_models(workspace: Workspace) -> list[Model]:
    """Return the existing models of a workspace, all in SPC coordinates.

    SPC maplets, registered mapolas, fused maplets, the three kinds of bigmaps, and the shape.
    """
    maplets, shape = _maplets(workspace), _shape(workspace)
    models: list[Model] = [*maplets]
    if workspace.mapola_names() and workspace.registration_path.is_file():
        models.append(_registered_mapolas(workspace))
    if workspace.fused_names():
        models.append(MapletModel("fused maplets", workspace.fused_names(), workspace.fused))
    for folder, title in _BIGMAPS:
        paths = {path.stem: path for path in _maps(workspace.home / "bigmaps" / folder)}
        if paths:
            models.append(_maps_of(title, paths))
    return [*models, *shape]


def solution_models(workspace: Workspace) -> list[MapletModel | MeshModel]:
    """Return the models that are part of the SPC solution itself: maplets and shape."""
    return [*_maplets(workspace), *_shape(workspace)]


def file_model(path: Path, *, frame: Frame = "spc", unit: Literal["km", "m"] = "km") -> Model:
    """Return the model in a file or folder, recognised by content and suffix.

    A folder with ``fused.h5`` (``fused/`` or a release) or with .MAP files, ``.MAP``, FITS or
    GeoTIFF of spcola, OBJ or PLY of spcola (with a frame: a maplet), ICQ, any other OBJ or PLY (a
    mesh).

    Parameters
    ----------
    path : Path
    frame : {"spc", "body"}
        Its coordinates: of the SPC solution, or the true body-fixed ones.
    unit : {"km", "m"}
        Unit of an OBJ or PLY that states none.

    Raises
    ------
    FormatError, WorkspaceError
        If it is none of these, or damaged.
    """
    if path.is_dir():
        if not (path / FUSED_HDF5).is_file():
            if maps := {one.stem: one for one in _maps(path)}:
                return _maps_of(str(path), maps, frame)
            what = f"holds neither {FUSED_HDF5} nor .MAP files"
            raise WorkspaceError(what, path, "name a release, a fused folder, or a file")
        names = fused_names(path)
        return MapletModel(str(path), names, lambda name: read_fused(path, name), frame)
    surface = read_terrain(path, unit=unit)
    if isinstance(surface, Maplet):
        maplet = surface
        return MapletModel(path.name, [maplet.name], lambda _: maplet, frame)
    mesh = surface.mesh() if isinstance(surface, IcqShape) else surface
    return MeshModel(path.name, mesh, frame)


def _maplets(workspace: Workspace) -> list[MapletModel]:
    names = workspace.maplet_names()
    return [MapletModel("SPC maplets", names, workspace.maplet)] if names else []


def _shape(workspace: Workspace) -> list[MeshModel]:
    return [MeshModel("shape", workspace.shape())] if workspace.has_shape() else []


def _registered_mapolas(workspace: Workspace) -> Model:
    """Return the registered mapolas."""
    where = str(workspace.registration_path)
    content = workspace.read_json(workspace.registration_path.name)
    transform, placements = transform_of(content, where), mapola_registrations(content, where)

    def load(name: str) -> Maplet:
        mapola = workspace.mapola(name)
        placement = placements[name]
        spread = np.sqrt(np.diag(placement.covariance))
        return replace(mapola, grid=placement.grid(mapola.grid, transform), center_sigma=spread)

    return MapletModel("mapolas, registered", workspace.mapola_names(), load)


def _maps(folder: Path) -> list[Path]:
    return sorted(folder.glob("[!.]*.MAP"))


def _maps_of(title: str, paths: dict[str, Path], frame: Frame = "spc") -> Model:
    return MapletModel(title, list(paths), lambda name: read_maplet(paths[name], name=name), frame)
