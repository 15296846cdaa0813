"""What a workspace contains, listed page by page."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Any

from fusion.inspection import describe_file
from fusion.service.views.places import grid_json, place_json
from fusion.service.views.surfaces import SurfaceKind, surface_names
from fusion.service.views.surfaces.cache import Stamp, stamp_of
from fusion.service.views.surfaces.opening import BIGMAP_FOLDERS
from fusion.stages.ingest import scan_facts
from fusion.workspace import Workspace
from lidar.formats.native import scan_summary
from spcola.errors import InvalidValueError, SpcolaError
from spcola.formats.maplets import MapParts

_MOST = 1000


class ListKind(StrEnum):
    """What can be listed."""

    SCANS = "scans"
    IMAGES = "images"
    MAPLETS = "maplets"
    MAPOLAS = "mapolas"
    FUSED = "fused"
    BIGMAPS = "bigmaps"
    PAIRS = "pairs"


@dataclass(frozen=True)
class Page:
    """Part of a list.

    Attributes
    ----------
    items : tuple of mappings
        In the order of their names. One that cannot be read has `name` and `problem` only.
    next : str
        The last name of this page, after which the next one begins; empty at the end.
    total : int
        Of all pages.
    """

    items: tuple[Mapping[str, Any], ...]
    next: str
    total: int


def list_page(workspace: Workspace, kind: ListKind, *, after: str = "", limit: int = 100) -> Page:
    """Return a page of a list; only its items are read.

    Parameters
    ----------
    workspace : Workspace
    kind : ListKind
    after : str
        The name after which the page begins; it need not be there any more.
    limit : int
        Most items, 1 … 1000.

    Raises
    ------
    InvalidValueError
        If the limit is out of range.
    WorkspaceError
        If a folder cannot be listed.
    """
    if not 1 <= limit <= _MOST:
        raise InvalidValueError(f"must be 1 … {_MOST}, not {limit}", "limit")
    names, describe = _LISTS[kind]
    known = sorted(names(workspace))
    first = bisect_right(known, after) if after else 0
    chosen = known[first : first + limit]
    pairs = _pair_facts(workspace) if kind is ListKind.PAIRS else {}
    items = tuple(_item(workspace, name, describe) | pairs.get(name, {}) for name in chosen)
    more = first + limit < len(known)
    return Page(items, chosen[-1] if more else "", len(known))


def _item(
    workspace: Workspace, name: str, describe: Callable[[Workspace, str], dict[str, Any]]
) -> dict[str, Any]:
    """Return the facts of one item, or why it cannot be read."""
    try:
        return {"name": name, **describe(workspace, name)}
    except SpcolaError as error:
        return {"name": name, "problem": str(error)}


def _scan(workspace: Workspace, name: str) -> dict[str, Any]:
    path = workspace.scan_path(name)
    return _scan_facts(path, stamp_of(path))


@lru_cache(maxsize=4096)
def _scan_facts(path: Path, stamp: Stamp) -> dict[str, Any]:  # noqa: ARG001
    """Return the facts of a scan file; its checksum takes a hundredth of a second."""
    return scan_facts(scan_summary(path))


def _image(workspace: Workspace, name: str) -> dict[str, Any]:
    facts = describe_file(workspace.image_path(name))
    place = place_json(workspace.image(name).position)
    return {**facts, **place, "has_pixels": workspace.exposure_path(name).is_file()}


def _maplet(workspace: Workspace, name: str) -> dict[str, Any]:
    return grid_json(MapParts.open(workspace.maplet_path(name)).grid)


def _mapola(workspace: Workspace, name: str) -> dict[str, Any]:
    mapola = workspace.mapola(name)
    return {
        **grid_json(mapola.grid),
        "coverage": mapola.coverage,
        "returns": int(mapola.count.sum()),
    }


def _fused(workspace: Workspace, name: str) -> dict[str, Any]:
    return grid_json(MapParts.open(workspace.fused_path(name)).grid)


def _bigmap(workspace: Workspace, name: str) -> dict[str, Any]:
    """Return the frame of a site's bigmaps, and which of them there are."""
    paths = {
        part: workspace.home / folder / f"{name}.MAP" for part, folder in BIGMAP_FOLDERS.items()
    }
    there = {part: path for part, path in paths.items() if path.is_file()}
    grid = MapParts.open(next(iter(there.values()))).grid
    return {**grid_json(grid), "surfaces": [f"{name}:{part}" for part in there]}


def _pair(workspace: Workspace, name: str) -> dict[str, Any]:
    there = [one for one in surface_names(workspace, SurfaceKind.PAIR) if _stem(one) == name]
    return {"surfaces": there}


def _pair_facts(workspace: Workspace) -> dict[str, dict[str, Any]]:
    """Return what scale.json has on each pair, by image."""
    content = workspace.find_json(workspace.scale_path.name) or {}
    return {str(entry.get("image")): entry for entry in content.get("per_pair") or []}


def _stem(name: str) -> str:
    return name.rpartition(":")[0]


def _stems(kind: SurfaceKind) -> Callable[[Workspace], list[str]]:
    """Return what lists the sites or images of surfaces of several parts."""
    return lambda workspace: list({_stem(name) for name in surface_names(workspace, kind)})


_LISTS: Mapping[
    ListKind,
    tuple[Callable[[Workspace], list[str]], Callable[[Workspace, str], dict[str, Any]]],
] = {
    ListKind.SCANS: (lambda workspace: workspace.scan_names(), _scan),
    ListKind.IMAGES: (lambda workspace: workspace.image_names(), _image),
    ListKind.MAPLETS: (lambda workspace: workspace.maplet_names(), _maplet),
    ListKind.MAPOLAS: (lambda workspace: workspace.mapola_names(), _mapola),
    ListKind.FUSED: (lambda workspace: workspace.fused_names(), _fused),
    ListKind.BIGMAPS: (_stems(SurfaceKind.BIGMAP), _bigmap),
    ListKind.PAIRS: (_stems(SurfaceKind.PAIR), _pair),
}
