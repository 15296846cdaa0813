"""Pictures of shapes: three views along the axes of the body, shaded and coloured by radius."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.inspection.look.picture import Picture, set_title
from fusion.inspection.look.shading import colour_bar, length_unit, limits_of, shaded_colours
from fusion.report.layout import styled_figure
from spcola.arrays import FloatArray
from spcola.shape import Hits, Mesh, RayCaster

_PIXELS = 420
# From where one looks, and what is to the right and up in the picture.
_VIEWS = (
    ("from +X", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), ("y", "z")),
    ("from +Y", (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), ("−x", "z")),
    ("from +Z", (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("x", "y")),
)
# Direction of the light in a picture: from the upper left, 45° high.
_LIGHT = np.array([-0.5, 0.5, np.sqrt(0.5)])


def shape_picture(mesh: Mesh, *, name: str, form: str) -> Picture:
    """Draw a shape from +X, +Y and +Z at one scale, as seen from far away.

    Parameters
    ----------
    mesh : Mesh
        Body-fixed, metres.
    name : str
        For the heading.
    form : str
        What it was read from, such as "ICQ" or "OBJ, taken as km".
    """
    caster = RayCaster(mesh)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    reach = 0.53 * float(np.max(high - low))
    unit = length_unit(reach)
    radius = np.linalg.norm(mesh.vertices, axis=1) / unit[0]
    scale = ("viridis", limits_of(radius, 0.0))
    with styled_figure(12.4, 5.3) as figure:
        panels = figure.subplots(1, 3)
        for panel, view in zip(panels, _VIEWS, strict=True):
            _draw_view(panel, caster, view, (reach, unit), scale)
        colour_bar(figure, panels[1], scale, f"distance from the body's centre, {unit[1]}")
        set_title(figure, f"{name}, shape ({form})", _caption(mesh, high - low, unit))
    facts = {
        "name": name,
        "vertices": len(mesh.vertices),
        "facets": len(mesh.facets),
        "lowest_m": low,
        "highest_m": high,
        "volume_m3": mesh.volume,
        "radius_m": [float(radius.min() * unit[0]), float(radius.max() * unit[0])],
    }
    return Picture("shape", figure, facts)


def smooth_normals(mesh: Mesh, hits: Hits) -> FloatArray:
    """Return unit normals (N, 3) where rays hit, interpolated between the vertices' normals.

    Facets of a coarse shape would hide its relief. NaN where a ray hits nothing.
    """
    at_vertices = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(at_vertices, mesh.facets[:, corner], mesh.area_vectors)
    hit = hits.hit
    corners = mesh.corners[hits.facet[hit]]
    weights = _barycentric(corners, hits.points[hit])
    normals = np.full((len(hits), 3), np.nan)
    mixed = np.einsum("nk,nkj->nj", weights, at_vertices[mesh.facets[hits.facet[hit]]])
    with np.errstate(invalid="ignore", divide="ignore"):
        normals[hit] = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    return normals


def _barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Return the weights (N, 3) of the corners (N, 3, 3) of facets at points (N, 3) on them."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    square = np.maximum(np.sum(normal**2, axis=1), np.finfo(float).tiny)
    first = np.sum(np.cross(c - b, points - b) * normal, axis=1) / square
    second = np.sum(np.cross(a - c, points - c) * normal, axis=1) / square
    weights: FloatArray = np.clip(np.stack([first, second, 1 - first - second], axis=1), 0, 1)
    return weights


def _draw_view(
    panel: Any,
    caster: RayCaster,
    view: tuple[str, Any, Any, Any, tuple[str, str]],
    window: tuple[float, tuple[float, str]],
    scale: tuple[str, tuple[float, float]],
) -> None:
    """Draw what is seen from far away along an axis."""
    title, away, right, up, axes = view
    reach, (metres, unit) = window
    frame = np.array([right, up, away])
    steps = (np.arange(_PIXELS) + 0.5) / _PIXELS * 2.0 * reach - reach
    across, high = np.meshgrid(steps, steps[::-1])
    middle = caster.center
    start = middle + np.stack([across, high, np.full_like(high, 4.0 * reach)], axis=-1) @ frame
    rays = start.reshape(-1, 3)
    hits = caster.cast(rays, np.broadcast_to(-frame[2], rays.shape))
    normals = smooth_normals(caster.mesh, hits) @ frame.T
    shade = np.clip(normals @ _LIGHT, 0.0, 1.0).reshape(_PIXELS, _PIXELS)
    radius = (np.linalg.norm(hits.points, axis=1) / metres).reshape(_PIXELS, _PIXELS)
    image = shaded_colours(radius, shade, *scale)
    # Around the body is sky, not an unknown place of it.
    image[~hits.hit.reshape(_PIXELS, _PIXELS)] = (1.0, 1.0, 1.0, 0.0)
    x, y = frame[0] @ middle, frame[1] @ middle
    extent = np.array([x - reach, x + reach, y - reach, y + reach]) / metres
    panel.imshow(image, extent=tuple(extent), interpolation="bilinear", zorder=2)
    panel.set(xlabel=f"{axes[0]}, {unit}", ylabel=f"{axes[1]}, {unit}")
    panel.set_title(title)
    panel.grid(visible=True)
    if axes[0].startswith("−"):
        panel.xaxis.set_major_formatter(lambda value, _: f"{-value + 0.0:g}".replace("-", "−"))
        panel.set_xlabel(f"{axes[0][1:]} (to the left), {unit}")


def _caption(mesh: Mesh, sides: FloatArray, unit: tuple[float, str]) -> str:
    metres, name = unit
    size = " × ".join(f"{side / metres:.4g}" for side in sides)
    return (
        f"{len(mesh.vertices)} vertices, {len(mesh.facets)} facets; {size} {name} along x, y, z; "
        f"volume {mesh.volume / metres**3:.5g} {name}³, mean radius "
        f"{mesh.mean_radius / metres:.5g} {name}. Light from the upper left."
    )
