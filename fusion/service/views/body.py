"""The shape of the body as a binary mesh, and layers on its vertices."""

from __future__ import annotations

import json
from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fusion.runtime import content_digest
from fusion.service.views.surfaces import LayerCache, SurfaceKind, surface_names
from fusion.service.views.surfaces.cache import stamp_of, state_of
from fusion.service.views.surfaces.layers import LAYERS
from fusion.service.views.surfaces.opening import open_surfaces
from fusion.service.views.surfaces.sampling import sampled
from fusion.service.views.surfaces.surface import Surface
from fusion.workspace import Workspace
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.shape import Mesh, decimated

__all__ = [
    "PAGE_FACETS",
    "SHAPE_LAYERS",
    "mesh_bytes",
    "shape_bytes",
    "shape_etag",
    "shape_layers",
    "shape_mesh",
    "vertex_layer",
]

PAGE_FACETS = 1_000_000
"""Facets that the page asks for at most (MOST_FACETS there)."""
SHAPE_LAYERS: Mapping[str, tuple[SurfaceKind, ...]] = {
    "albedo": (SurfaceKind.MAPLET,),
    "difference": (SurfaceKind.FUSED,),
    "sigma": (SurfaceKind.FUSED, SurfaceKind.MAPLET),
    "count": (SurfaceKind.FUSED, SurfaceKind.MAPOLA),
    "source": (SurfaceKind.FUSED,),
}
"""Layers on the vertices, and the kinds of surfaces that have them: the first one there is used."""

_FOLDERS = {
    SurfaceKind.MAPLET: "MAPFILES", SurfaceKind.MAPOLA: "mapolas", SurfaceKind.FUSED: "fused",
}  # fmt: skip


def shape_mesh(
    workspace: Workspace, facets: int | None = None, *, cache: LayerCache | None = None
) -> Mesh:
    """Return the shape model, with at most about as many `facets` if given.

    Parameters
    ----------
    workspace : Workspace
    facets : int, optional
    cache : LayerCache, optional
        Keeps the mesh as long as the file is the same.

    Raises
    ------
    SpcolaError
        If there is no shape, or it cannot be read.
    """
    key = _key(workspace, facets)

    def make() -> dict[Hashable, AnyArray]:
        mesh = workspace.shape()
        mesh = mesh if facets is None else decimated(mesh, facets)
        return {"vertices": mesh.vertices, "facets": mesh.facets}

    kept = cache or LayerCache()
    vertices, faces = (kept.find(key, part, make, slow=True) for part in ("vertices", "facets"))
    return Mesh(vertices, faces)


def mesh_bytes(mesh: Mesh) -> bytes:
    """Return a mesh as bytes, all little-endian.

    ``uint32`` length of the header; the header, JSON with ``vertices`` and ``faces`` (their
    numbers) and ``center_m``, filled with blanks to a multiple of four bytes; vertices,
    ``float32`` (V, 3), metres from that centre; faces, ``uint32`` (F, 3), counter-clockwise seen
    from outside.

    Parameters
    ----------
    mesh : Mesh
    """
    center = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0
    content = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.facets),
        "center_m": center.tolist(),
    }
    header = json.dumps(content).encode()
    header += b" " * (-len(header) % 4)
    parts = (
        np.uint32(len(header)).astype("<u4").tobytes(),
        header,
        (mesh.vertices - center).astype("<f4").tobytes(),
        mesh.facets.astype("<u4").tobytes(),
    )
    return b"".join(parts)


def shape_bytes(
    workspace: Workspace, facets: int | None = None, *, cache: LayerCache | None = None
) -> bytes:
    """Return :func:`shape_mesh` as :func:`mesh_bytes`, kept as long as the file is the same.

    Parameters
    ----------
    workspace : Workspace
    facets : int, optional
    cache : LayerCache, optional

    Raises
    ------
    SpcolaError
        If there is no shape, or it cannot be read.
    """
    kept = cache or LayerCache()

    def make() -> dict[Hashable, AnyArray]:
        content = mesh_bytes(shape_mesh(workspace, facets, cache=kept))
        return {"bytes": np.frombuffer(content, dtype=np.uint8)}

    return kept.find((*_key(workspace, facets), "bytes"), "bytes", make, slow=True).tobytes()


def shape_layers(workspace: Workspace) -> list[dict[str, Any]]:
    """Return the layers of which there are surfaces: name, meaning, unit, colours and source.

    Parameters
    ----------
    workspace : Workspace

    Raises
    ------
    WorkspaceError
        If a folder cannot be listed.
    """
    found = []
    every = {kind for kinds in SHAPE_LAYERS.values() for kind in kinds}
    numbers = {kind: len(surface_names(workspace, kind)) for kind in every}
    for name, kinds in SHAPE_LAYERS.items():
        for kind in [each for each in kinds if numbers[each]][:1]:
            about = LAYERS[name]
            known = {"text": about.text, "unit": about.unit, "colours": about.colours}
            found.append({"name": name, **known, "of": kind.value, "surfaces": numbers[kind]})
    return found


def vertex_layer(
    workspace: Workspace,
    layer: str,
    facets: int | None = None,
    *,
    cache: LayerCache | None = None,
) -> FloatArray:
    """Return a layer on the vertices of :func:`shape_mesh` (V,), float32; NaN where none is known.

    Where several surfaces cover a vertex, the one of the smallest GSD that has a height counts; of
    equals the first by name. Values between grid points are as in
    :func:`fusion.service.views.surfaces.value_at`.

    Parameters
    ----------
    workspace : Workspace
    layer : str
        One of :data:`SHAPE_LAYERS`.
    facets : int, optional
        As for the mesh.
    cache : LayerCache, optional

    Raises
    ------
    InvalidValueError
        If there is no such layer.
    SpcolaError
        If there is no shape, or a file is damaged.
    """
    kept, key = cache or LayerCache(), _key(workspace, facets, layer)

    def make() -> dict[Hashable, AnyArray]:
        mesh = shape_mesh(workspace, facets, cache=kept)
        chosen = _first_there(workspace, SHAPE_LAYERS[layer])
        surfaces = [each for kind, _ in chosen for each in open_surfaces(workspace, kind, kept)]
        return {"values": _interpolated(mesh, surfaces, layer)}

    return kept.find(key, "values", make, slow=True)


def shape_etag(workspace: Workspace, facets: int | None = None, layer: str = "") -> str:
    """Return a text that changes whenever the mesh, or a `layer` on it, does; raises as they do."""
    return content_digest(repr(_key(workspace, facets, layer)))[:32]


def _key(workspace: Workspace, facets: int | None, layer: str = "") -> tuple[Hashable, ...]:
    """Return what the mesh, or a layer on it, is made from."""
    mesh = (stamp_of(workspace.shape_path()), facets)
    if not layer:
        return mesh
    if layer not in SHAPE_LAYERS:
        names = ", ".join(SHAPE_LAYERS)
        raise InvalidValueError(f"the shape has no layer {layer!r}", do=f"there are: {names}")
    there = _first_there(workspace, SHAPE_LAYERS[layer])
    # Fused maplets are compared with those of SPC.
    folders = {"MAPFILES", *(_FOLDERS[kind] for kind, _ in there)}
    surfaces = [(kind.value, *names) for kind, names in there]
    state = state_of(*(workspace.home / folder for folder in sorted(folders)))
    return (*mesh, layer, content_digest(surfaces), state)


def _first_there(
    workspace: Workspace, kinds: tuple[SurfaceKind, ...]
) -> list[tuple[SurfaceKind, list[str]]]:
    """Return the first kind of which there are surfaces, with their names; or nothing."""
    found = [(kind, surface_names(workspace, kind)) for kind in kinds]
    return [(kind, names) for kind, names in found if names][:1]


def _interpolated(mesh: Mesh, surfaces: list[Surface], layer: str) -> FloatArray:
    """Return a layer (V,) of surfaces, the preferred ones first."""
    values = np.full(len(mesh.vertices), np.nan, dtype=np.float32)
    tree, normals = cKDTree(mesh.vertices), _vertex_normals(mesh)
    for surface in surfaces:
        if layer not in surface.source.layers:
            continue
        grid = surface.grid
        near = np.array(tree.query_ball_point(grid.center, 2.0 * grid.radius), dtype=np.int64)
        near = near[np.isnan(values[near])]
        down, right, height = grid.project(mesh.vertices[near])
        inside = np.maximum(np.abs(down), np.abs(right)) <= grid.half_size
        # The far side of a thin body lies above the grid, too.
        inside &= (np.abs(height) <= grid.radius) & (normals[near] @ grid.uz > 0.0)
        near = near[inside]
        if len(near):
            x, y = right[inside] * grid.gsd, -down[inside] * grid.gsd
            found = sampled(surface, x, y, ["height", layer])
            values[near] = np.where(np.isfinite(found["height"]), found[layer], np.nan)
    return values


def _vertex_normals(mesh: Mesh) -> FloatArray:
    """Return outward normals (V, 3) of any length."""
    corners, count = mesh.facets.ravel(), len(mesh.vertices)
    areas = np.repeat(mesh.area_vectors, 3, axis=0)
    return np.stack([np.bincount(corners, areas[:, k], count) for k in range(3)], axis=1)
