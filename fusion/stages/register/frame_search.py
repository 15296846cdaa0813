"""The search for the lidar's frame in a workspace: its returns against its SPC surface."""

from __future__ import annotations

import numpy as np

from fusion.registration.search import FrameSearch, cells_of, search_frames
from fusion.scene.geolocation import located_store
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.arrays import FloatArray
from spcola.errors import SpcolaError
from spcola.shape import Mesh, sample_surface

# More returns, maplets and nodes take more time without improving on a tenth of a degree.
_RETURNS, _MAPLETS, _NODES = 400_000, 1000, 400_000
_SHAPE_STEP_DEG = 0.7
# Cells of a right angle in which maplets replace the shape.
_CELLS = 32


def search_workspace_frames(workspace: Workspace, settings: Settings) -> FrameSearch:
    """Search for the rotation, mirrored axis, unit or shift by which lidar fits the SPC surface.

    Returns are geolocated by `settings`, without the adjustment of scans. The surface is that of
    the registration: the shape, or the maplets, with the shape where there is no maplet.

    Raises
    ------
    SpcolaError
        If there are no returns or no surface, or they cannot be read.
    """
    store = located_store(workspace, settings.mapolas, settings.spin, settings.spice)
    return search_frames(store.spread(_RETURNS), surface_points(workspace, settings))


def surface_points(workspace: Workspace, settings: Settings) -> FloatArray:
    """Return points (N, 3) of the SPC surface, metres, about a degree apart or closer.

    Raises
    ------
    SpcolaError
        If there is none, or it cannot be read.
    """
    names = [] if settings.registration.against == "shape" else workspace.maplet_names()
    if not names:
        return _shape_points(workspace.shape())
    nodes = _maplet_points(workspace, names)
    if not workspace.has_shape():
        return nodes
    try:
        shape = _shape_points(workspace.shape())
    except SpcolaError:
        # Registration to maplets needs no shape.
        return nodes
    bare = ~np.isin(cells_of(shape, _CELLS), cells_of(nodes, _CELLS))
    return np.concatenate([nodes, shape[bare]])


def _maplet_points(workspace: Workspace, names: list[str]) -> FloatArray:
    """Return nodes (N, 3) of maplets, metres: all, or an even selection of many."""
    names = names[:: -(-len(names) // _MAPLETS)]
    parts = []
    for name in names:
        points = workspace.maplet(name).points()
        every = max(1, int(np.ceil(np.sqrt(len(names) * points[..., 0].size / _NODES))))
        part = points[::every, ::every].reshape(-1, 3)
        parts.append(part[np.isfinite(part).all(axis=1)])
    return np.concatenate(parts)


def _shape_points(mesh: Mesh) -> FloatArray:
    return sample_surface(mesh, np.radians(_SHAPE_STEP_DEG) * mesh.mean_radius).points
