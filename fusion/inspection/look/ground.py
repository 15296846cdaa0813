"""How points on the ground are laid out flat: over a body, around a site, or as a plain map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fusion.inspection.look.numbers import place_text
from fusion.inspection.look.shading import length_unit
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid
from spcola.math import lon_lat_deg

# Points that are seen within this angle from the body's centre are drawn as a site.
_SITE_DEG = 80.0
# A cloud whose normal is further than this from the direction of the origin has another origin.
_FOREIGN_DEG = 60.0
# Thickness of a cloud over its shorter side, below which it lies over a plane.
_FLAT = 0.25
# Width of a cloud over its length, below which it is a track.
_WIDE = 0.1
# Share of the points that a direction must be near to.
_NEARLY_ALL = 99.0


Frame = Literal["unknown", "body-fixed", "projected"]


@dataclass(frozen=True, eq=False)
class GroundView:
    """Points laid out flat.

    Attributes
    ----------
    kind : {"body", "site", "map"}
        Longitude and latitude; metres east and north of a site on a body; or x and y as they are.
    x, y : (N,) ndarrays
        Degrees for a body, else in `unit`.
    height : (N,) ndarray
        In `unit`: distance from the body's centre less `reference`, or height over the plane.
    unit : {"m", "km"}
    labels : (str, str, str, str)
        Of x, y and height, with their units; and of height in short.
    """

    kind: Literal["body", "site", "map"]
    x: FloatArray
    y: FloatArray
    height: FloatArray
    unit: str
    labels: tuple[str, str, str, str]


def lay_out(points: FloatArray, *, frame: Frame = "unknown") -> GroundView:
    """Lay points out flat in the way that suits where they lie.

    Points all around the origin are a body: longitude and latitude. Points within 80° seen from
    the origin are a site, drawn in an azimuthal plane, east and north. A cloud over a plane that
    does not face the origin has coordinates of its own: x and y as they are.

    Parameters
    ----------
    points : (N, 3) ndarray
        Metres, N at least 1.
    frame : {"unknown", "body-fixed", "projected"}
        What is known of the coordinates: of a map projection z is the height.
    """
    if frame == "projected":
        return _map_of(points)
    middle = points.mean(axis=0)
    away = float(np.linalg.norm(middle))
    site = away > 0.0 and _angle_deg(points, middle / away) < _SITE_DEG
    if frame == "unknown" and _has_own_origin(points, middle, site):
        return _map_of(points)
    return _site_of(points, middle) if site else _body(points)


def _has_own_origin(points: FloatArray, middle: FloatArray, site: bool) -> bool:
    """Return whether points lie over a plane that no body around the origin has there."""
    arms = points - middle
    spans, axes = np.linalg.eigh(arms.T @ arms / len(points))
    if not (spans[1] > _WIDE**2 * spans[2] and spans[0] < _FLAT**2 * spans[1]):
        return False
    if site:
        facing = abs(float(axes[:, 0] @ middle)) / float(np.linalg.norm(middle))
        return facing < np.cos(np.radians(_FOREIGN_DEG))
    # A ring of tracks around a body is flat too, but nothing of it is near the origin.
    near, far = np.percentile(np.linalg.norm(points, axis=1), (5, 95))
    return bool(near < 0.5 * far)


def _angle_deg(points: FloatArray, direction: FloatArray) -> float:
    """Angle from a direction within which nearly all points are seen from the origin, degrees."""
    radius = np.maximum(np.linalg.norm(points, axis=1), np.finfo(float).tiny)
    cosine = np.clip(points @ direction / radius, -1.0, 1.0)
    return float(np.percentile(np.degrees(np.arccos(cosine)), _NEARLY_ALL))


def _body(points: FloatArray) -> GroundView:
    """Lay out longitude and latitude over a whole body."""
    longitude, latitude = lon_lat_deg(points)
    radius = np.linalg.norm(points, axis=1)
    metres, unit = length_unit(float(radius.max()))
    long = f"distance from the body's centre, {unit}"
    labels = ("east longitude, °", "latitude, °", long, f"radius, {unit}")
    return GroundView("body", longitude, latitude, radius / metres, unit, labels)


def _site_of(points: FloatArray, middle: FloatArray) -> GroundView:
    """Lay out east and north of a site, metres along the ground (azimuthal, equidistant)."""
    grid = MapletGrid.facing(middle, middle, 1.0, 1)
    radius = np.linalg.norm(points, axis=1)
    reference = float(np.median(radius))
    south, east, up = (points @ grid.axes.T).T
    across = np.hypot(south, east)
    # Arc on the mean sphere for a chord of the unit sphere; 1 at the middle.
    angle = np.arctan2(across, up)
    stretch = reference * np.divide(angle, across, out=np.full(len(across), 1 / reference),
                                    where=across > 0)  # fmt: skip
    x, y = east * stretch, -south * stretch
    metres, unit = length_unit(float(max(np.ptp(x), np.ptp(y))))
    height = radius - reference
    tall, height_unit = length_unit(float(np.ptp(height)))
    far, far_unit = length_unit(reference)
    labels = (
        f"east of {place_text(middle)}, {unit}",
        f"north, {unit}",
        f"height: distance from the body's centre less {reference / far:.7g} {far_unit}, "
        f"{height_unit}",
        f"height, {height_unit}",
    )
    return GroundView("site", x / metres, y / metres, height / tall, unit, labels)


def _map_of(points: FloatArray) -> GroundView:
    """Lay out x and y as they are, z as the height."""
    x, y, z = points.T
    metres, unit = length_unit(float(max(np.ptp(x), np.ptp(y))))
    # Long coordinates of a map projection hide what they differ by.
    corner = np.floor(np.array([x.min(), y.min()]) / metres)
    begun = [f"{start:.0f} + " if abs(start) > 1e4 else "" for start in corner]
    off = [start if abs(start) > 1e4 else 0.0 for start in corner]
    labels = (f"x, {begun[0]}{unit}", f"y, {begun[1]}{unit}", "z, m", "z, m")
    return GroundView("map", x / metres - off[0], y / metres - off[1], z, unit, labels)
