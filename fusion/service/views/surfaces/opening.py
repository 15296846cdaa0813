"""The surfaces of a workspace by kind and name."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from enum import StrEnum
from pathlib import Path

from fusion.fusing.maplets import FUSED_HDF5, FUSED_STORE
from fusion.products import MANIFEST_FILE
from fusion.products.formats import read_fits_dtm, read_geotiff
from fusion.service.views.surfaces.cache import LayerCache, stamp_of
from fusion.service.views.surfaces.sources import (
    ArraySource,
    MapSource,
    Source,
    StoredSource,
    compared,
)
from fusion.service.views.surfaces.surface import Surface
from fusion.workspace import Workspace, visible_files
from lidar.formats.mapolas import MAPOLA_STORE
from spcola.errors import WorkspaceError

_FUSED_LAYERS = ("height", "sigma", "albedo", "count", "source")
_MAPOLA_LAYERS = ("height", "sigma", "count")
BIGMAP_FOLDERS = {
    "fused": "bigmaps",
    "spc": "bigmaps/maplets",
    "lidar": "bigmaps/returns",
    "albedo": "bigmaps/albedo",
}
"""Folders of bigmaps by what they are made of."""
_PAIRS = {"spc": "maplets", "lidar": "returns"}
_DTM_READERS = {".fits": read_fits_dtm, ".tif": read_geotiff}


class SurfaceKind(StrEnum):
    """What a surface is.

    A bigmap is named ``SITE:fused``, ``SITE:spc``, ``SITE:lidar`` or, the fused one with solved
    albedo, ``SITE:albedo``; one of a pair ``IMAGE:spc`` or ``IMAGE:lidar``; and a released terrain
    model by its maplet or site.
    """

    MAPLET = "maplet"
    MAPOLA = "mapola"
    FUSED = "fused"
    BIGMAP = "bigmap"
    PAIR = "pair"
    DTM = "dtm"


def surface_names(workspace: Workspace, kind: SurfaceKind) -> list[str]:
    """Return the names of the surfaces of one `kind` in a `workspace`, sorted.

    Raises
    ------
    WorkspaceError
        If a folder cannot be listed.
    """
    return sorted(_NAMES[kind](workspace))


def open_surface(
    workspace: Workspace, kind: SurfaceKind, name: str, *, cache: LayerCache | None = None
) -> Surface:
    """Open a surface; its layers are read when they are asked for.

    Parameters
    ----------
    workspace : Workspace
    kind : SurfaceKind
    name : str
        One of :func:`surface_names`.
    cache : LayerCache, optional
        Where overview levels are kept; by default as long as the surface.

    Raises
    ------
    WorkspaceError
        If there is no such surface.
    FormatError
        If a file of it is damaged.
    """
    # A name is compared with those that are there, and never becomes part of a path before.
    if not _is_there(workspace, kind, name):
        raise WorkspaceError(
            f"there is no {kind} {name!r}", workspace.root, "list those that there are"
        )
    return _opened(workspace, kind, name, cache or LayerCache())


def open_surfaces(workspace: Workspace, kind: SurfaceKind, cache: LayerCache) -> list[Surface]:
    """Open all surfaces of one `kind`, those of the smallest GSD first, of equals by name.

    Parameters
    ----------
    workspace : Workspace
    kind : SurfaceKind
    cache : LayerCache

    Raises
    ------
    SpcolaError
        If a folder cannot be listed, or a file is damaged.
    """
    found = [_opened(workspace, kind, name, cache) for name in surface_names(workspace, kind)]
    return sorted(found, key=lambda surface: surface.grid.gsd)


def _is_there(workspace: Workspace, kind: SurfaceKind, name: str) -> bool:
    """Return whether there is a surface of this name."""
    if kind is SurfaceKind.MAPLET:
        # The files of the others are not looked for.
        return name in workspace.maplet_names() and workspace.maplet_path(name).is_file()
    if kind is SurfaceKind.BIGMAP:
        part = name.rpartition(":")[2]
        return part in BIGMAP_FOLDERS and name in _bigmap_names(workspace, [part])
    return name in _NAMES[kind](workspace)


def _opened(workspace: Workspace, kind: SurfaceKind, name: str, cache: LayerCache) -> Surface:
    """Open a surface that is there."""
    source = _OPENERS[kind](workspace, name)
    reference = _spc_file(workspace, kind, name)
    if reference is not None and reference.is_file():
        source = compared(source, MapSource.open(reference), cache)
    return Surface(kind.value, name, source, cache)


def _spc_file(workspace: Workspace, kind: SurfaceKind, name: str) -> Path | None:
    """Return the SPC surface with which a surface is compared; None for those of another frame."""
    place, _, part = name.rpartition(":")
    maplets = workspace.home / BIGMAP_FOLDERS["spc"]
    if kind is SurfaceKind.FUSED:
        return workspace.maplet_path(name)
    if kind is SurfaceKind.DTM:
        path = workspace.maplet_path(name)
        return path if path.is_file() else maplets / f"{name}.MAP"
    if kind is SurfaceKind.BIGMAP and part != "spc":
        return maplets / f"{place}.MAP"
    if kind is SurfaceKind.PAIR and part != "spc":
        return workspace.pair_path(place, "maplets")
    return None


def _maplet_names(workspace: Workspace) -> list[str]:
    folder = workspace.home / "MAPFILES"
    if not folder.is_dir():
        return []
    # The folder is read once: to ask for each of thousands of files takes four times as long.
    with os.scandir(folder) as entries:
        there = {entry.name for entry in entries if _is_file(entry)}
    return [name for name in workspace.maplet_names() if f"{name}.MAP" in there]


def _is_file(entry: os.DirEntry[str]) -> bool:
    """Return whether an entry is a file; a link that leads in a circle is none."""
    try:
        return entry.is_file()
    except OSError:
        return False


def _bigmap_names(workspace: Workspace, parts: Iterable[str] = BIGMAP_FOLDERS) -> list[str]:
    return [
        f"{path.stem}:{part}"
        for part in parts
        for path in visible_files(workspace.home / BIGMAP_FOLDERS[part], ".MAP")
    ]


def _pair_names(workspace: Workspace) -> list[str]:
    stems = [path.stem.rpartition("-") for path in visible_files(workspace.home / "pairs", ".MAP")]
    parts = {kind: part for part, kind in _PAIRS.items()}
    return [f"{image}:{parts[kind]}" for image, _, kind in stems if kind in parts]


def _products(workspace: Workspace) -> dict[str, dict[str, Path]]:
    """Return the files of each released terrain model, by maplet and kind."""
    manifest = workspace.find_json(f"release/{MANIFEST_FILE}") or {}
    found: dict[str, dict[str, Path]] = {}
    for entry in manifest.get("products", []):
        name = str(entry.get("file"))
        path = workspace.home / "release" / name
        if entry.get("maplet") and Path(name).name == name and path.is_file():
            found.setdefault(str(entry["maplet"]), {})[str(entry.get("kind"))] = path
    readable = {"map", "fits", "geotiff"}
    return {name: files for name, files in found.items() if readable & files.keys()}


def _bigmap(workspace: Workspace, name: str) -> Source:
    site, _, part = name.rpartition(":")
    return MapSource.open(workspace.home / BIGMAP_FOLDERS[part] / f"{site}.MAP")


def _pair(workspace: Workspace, name: str) -> Source:
    image, _, part = name.rpartition(":")
    return MapSource.open(workspace.pair_path(image, _PAIRS[part]))


def _dtm(workspace: Workspace, name: str) -> Source:
    """Open a released terrain model: the HDF5 of the release, else FITS or GeoTIFF."""
    files, folder = _products(workspace)[name], workspace.home / "release"
    if "map" in files and (folder / FUSED_HDF5).is_file():
        return StoredSource.open(FUSED_STORE, folder, name, _FUSED_LAYERS)
    path = next(files[kind] for kind in ("fits", "geotiff", "map") if kind in files)
    if path.suffix not in _DTM_READERS:
        return MapSource.open(path)
    stamp, maplet = stamp_of(path), _DTM_READERS[path.suffix](path)
    layers = {name: getattr(maplet, name) for name in _FUSED_LAYERS if hasattr(maplet, name)}
    return ArraySource(maplet.grid, layers, stamp)


_NAMES: dict[SurfaceKind, Callable[[Workspace], list[str]]] = {
    SurfaceKind.MAPLET: _maplet_names,
    SurfaceKind.MAPOLA: lambda workspace: workspace.mapola_names(),
    SurfaceKind.FUSED: lambda workspace: workspace.fused_names(),
    SurfaceKind.BIGMAP: _bigmap_names,
    SurfaceKind.PAIR: _pair_names,
    SurfaceKind.DTM: lambda workspace: list(_products(workspace)),
}
_OPENERS: dict[SurfaceKind, Callable[[Workspace, str], Source]] = {
    SurfaceKind.MAPLET: lambda workspace, name: MapSource.open(workspace.maplet_path(name)),
    SurfaceKind.MAPOLA: lambda workspace, name: StoredSource.open(
        MAPOLA_STORE, workspace.home / "mapolas", name, _MAPOLA_LAYERS
    ),
    SurfaceKind.FUSED: lambda workspace, name: StoredSource.open(
        FUSED_STORE, workspace.home / "fused", name, _FUSED_LAYERS
    ),
    SurfaceKind.BIGMAP: _bigmap,
    SurfaceKind.PAIR: _pair,
    SurfaceKind.DTM: _dtm,
}
