"""How one solution differs from another: centres, heights, states, shape, pole and scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.owen_fit import camera_difference
from spcola.errors import InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.math import Similarity, similarity_between

_PERCENT = (50, 95, 100)
# Heights of nodes that are further apart than this, in GSD, are not compared.
_APART = 0.5
_ROUNDING_PX = 1e-6


@dataclass(frozen=True, eq=False)
class SolutionDifference:
    """A second solution less a first one, item by item.

    Attributes
    ----------
    first, second : str
        Names of the solutions.
    maplets, images : tuple of str
        Those that both have, in the order of the arrays; line scans are images.
    only_first, only_second : tuple of str
        Maplets and images of one solution only.
    centers : (N, 3) ndarray
        Central vectors of the maplets in the first solution, metres.
    moved : (N, 3) ndarray
        Displacement of the centres, body-fixed, metres.
    outward : (N,) ndarray
        Its part along the normal of the maplet, metres.
    heights : (N,) ndarray
        Standard deviation over a maplet of the change of its heights, metres; NaN where its grid
        has other nodes: another number of them, GSD, or direction in its plane.
    positions : (M, 3) ndarray
        Change of the spacecraft positions along Cx, Cy and Cz, metres; of a line scan the largest
        of its lines, NaN if it has another number of lines.
    turns : (M, 3) ndarray
        Change of the pointing: rotations about Cx, Cy and Cz, radians; of a line scan likewise.
    cameras : (M,) ndarray
        Largest change of a pixel's place on the detector by focal length, K or distortion, pixels.
    common : Similarity or None
        The similarity that takes the first centres nearest to the second ones; None for fewer than
        three.
    radius_ratio : float
        Mean radius of the shape, second over first; NaN without shapes.
    settings : mapping of str to pair
        What differs in body constants, by ``table.key``: first and second value.
    """

    first: str
    second: str
    maplets: tuple[str, ...]
    images: tuple[str, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    centers: FloatArray
    moved: FloatArray
    outward: FloatArray
    heights: FloatArray
    positions: FloatArray
    turns: FloatArray
    cameras: FloatArray
    common: Similarity | None
    radius_ratio: float
    settings: Mapping[str, tuple[Any, Any]]

    @property
    def left_over(self) -> FloatArray:
        """Displacements (N, 3) of the centres beyond the common similarity, metres."""
        if self.common is None:
            return self.moved
        return self.centers + self.moved - self.common.apply(self.centers)

    def as_json(self) -> dict[str, Any]:
        """Return counts and percentiles in JSON types; keys carry units."""
        common = self.common
        return {
            "first": self.first,
            "second": self.second,
            "maplets": len(self.maplets),
            "images": len(self.images),
            "only_first": list(self.only_first),
            "only_second": list(self.only_second),
            "centers_moved_m": _percentiles(np.linalg.norm(self.moved, axis=1)),
            "centers_outward_m": _percentiles(np.abs(self.outward)),
            "centers_left_over_m": _percentiles(np.linalg.norm(self.left_over, axis=1)),
            "heights_changed_m": _percentiles(self.heights),
            "heights_compared": int(np.isfinite(self.heights).sum()),
            "positions_moved_m": _percentiles(np.linalg.norm(self.positions, axis=1)),
            "cameras_changed_px": _percentiles(self.cameras),
            "pointing_turned_deg": _percentiles(np.degrees(np.linalg.norm(self.turns, axis=1))),
            "common_scale": None if common is None else common.scale,
            "common_rotation_deg": None if common is None else np.degrees(common.rotation_vector),
            "common_shift_m": None if common is None else _shift(common, self.centers),
            "shape_radius_ratio": self.radius_ratio,
            "constants": {key: list(values) for key, values in self.settings.items()},
        }


def solution_difference(first: Workspace, second: Workspace) -> SolutionDifference:
    """Compare two solutions of a workspace.

    Parameters
    ----------
    first, second : Workspace
        The same workspace with one solution and with the other.

    Raises
    ------
    SpcolaError
        If a file of a solution cannot be read.
    """
    maplets = _shared(first.maplet_names(), second.maplet_names())
    stated = [[*each.image_names(), *each.line_scan_names()] for each in (first, second)]
    images = _shared(*stated)
    names = [
        {*each.maplet_names(), *some} for each, some in zip((first, second), stated, strict=True)
    ]
    rows = [_center_change(first, second, name) for name in maplets]
    centers, moved = (np.array([row[k] for row in rows]).reshape(-1, 3) for k in (0, 1))
    states = [_state_change(first, second, name) for name in images]
    positions, turns = (np.array([row[k] for row in states]).reshape(-1, 3) for k in (0, 1))
    try:
        common = similarity_between(centers, centers + moved) if len(rows) > 2 else None
    except InvalidValueError:
        common = None
    heights = [_height_change(first.maplet(each), second.maplet(each), common) for each in maplets]
    return SolutionDifference(
        first.solution, second.solution, maplets, images,
        tuple(sorted(names[0] - names[1])), tuple(sorted(names[1] - names[0])),
        centers, moved, np.array([row[2] for row in rows]), np.array(heights),
        positions, turns, np.array([row[2] for row in states]), common,
        _radius_ratio(first, second), _changed_settings(first, second),
    )  # fmt: skip


def difference_lines(content: Mapping[str, Any]) -> list[str]:
    """Return what people read of the difference of two solutions.

    Parameters
    ----------
    content : mapping
        :meth:`SolutionDifference.as_json`, or that read from JSON.
    """

    def row(text: str, key: str, unit: str) -> str:
        values = content[key]
        if values is None:
            return f"  {text}: none to compare"
        numbers = ", ".join(f"{values[f'p{p}']:.3g}" for p in _PERCENT)
        return f"  {text} (median, 95 %, largest): {numbers} {unit}"

    first, second, cameras = content["first"], content["second"], content["cameras_changed_px"]
    left_out = content["maplets"] - content["heights_compared"]
    others = f" (not of {left_out} with other grids)" if left_out else ""
    changed = cameras is not None and cameras["p100"] != 0.0
    lines = [
        f"{second} less {first}: {content['maplets']} maplets, {content['images']} images in both",
        row("centres moved", "centers_moved_m", "m"),
        row("  along their normals", "centers_outward_m", "m"),
        row("  beyond a common similarity", "centers_left_over_m", "m"),
        row(f"heights within a maplet{others}", "heights_changed_m", "m"),
        row("spacecraft moved", "positions_moved_m", "m"),
        row("pointing turned", "pointing_turned_deg", "°"),
        *([row("cameras changed", "cameras_changed_px", "px")] if changed else []),
    ]
    if content["common_scale"] is not None:
        turn = ", ".join(f"{value:.3g}" for value in content["common_rotation_deg"])
        shift = ", ".join(f"{value:.3g}" for value in content["common_shift_m"])
        lines.append(
            f"  all centres together: scale − 1 {1e6 * (content['common_scale'] - 1.0):.4g} · "
            f"10⁻⁶, rotation {turn} °, shift {shift} m"
        )
    ratio = content["shape_radius_ratio"]
    if ratio is not None and np.isfinite(ratio):
        lines.append(f"  mean radius of the shape: times {ratio:.7f}")
    lines += [f"  {key}: {old} → {new}" for key, (old, new) in content["constants"].items()]
    for name, only in ((first, content["only_first"]), (second, content["only_second"])):
        lines += [f"  only in {name}: {', '.join(only)}"] if only else []
    return lines


def _shared(first: Sequence[str], second: Sequence[str]) -> tuple[str, ...]:
    there = set(second)
    return tuple(name for name in first if name in there)


def _center_change(
    first: Workspace, second: Workspace, name: str
) -> tuple[FloatArray, FloatArray, float]:
    """Return the centre of a maplet, its displacement, and the part of that along the normal."""
    old, new = first.maplet(name).grid, second.maplet(name).grid
    moved = new.center - old.center
    return old.center, moved, float(moved @ old.axes[2])


def _height_change(old: Maplet, new: Maplet, common: Similarity | None) -> float:
    """Return the standard deviation of the change of heights; NaN if the nodes are others."""
    if _nodes_apart(old.grid, new.grid, common) > _APART:
        return float("nan")
    change = (new.height - old.height)[old.valid & new.valid]
    return float(np.std(change)) if change.size else float("nan")


def _nodes_apart(old: MapletGrid, new: MapletGrid, common: Similarity | None) -> float:
    """Return how far nodes of equal index are apart at most, in GSD, with the centres as one.

    The old grid is scaled and turned as all centres together are.
    """
    if old.half_size != new.half_size:
        return float("inf")
    axes, gsd = old.axes, old.gsd
    if common is not None:
        axes, gsd = axes @ common.rotation.T, gsd * common.scale
    edges = (new.gsd * new.axes[:2] - gsd * axes[:2]) @ axes[:2].T
    return old.half_size / gsd * float(np.linalg.norm(np.abs(edges).sum(axis=0)))


def _state_change(
    first: Workspace, second: Workspace, name: str
) -> tuple[FloatArray, FloatArray, float]:
    """Return the change of position and of pointing, in the camera axes, and of the camera."""
    old, new = _states(first, name), _states(second, name)
    camera = camera_difference(old.camera, new.camera).largest_px
    # Less than the decimals of a .SUM file is rounding.
    camera = camera if camera > _ROUNDING_PX else 0.0
    if len(old.axes) != len(new.axes):
        return np.full(3, np.nan), np.full(3, np.nan), camera
    turns = Rotation.from_matrix(old.axes @ np.swapaxes(new.axes, -1, -2)).as_rotvec()
    moved = np.einsum("nij,nj->ni", old.axes, new.positions - old.positions)
    return _largest(moved), _largest(turns), camera


class _States(NamedTuple):
    """Camera, positions (N, 3) and axes (N, 3, 3) of an image: one, or those of its lines."""

    camera: Camera
    positions: FloatArray
    axes: FloatArray


def _states(workspace: Workspace, name: str) -> _States:
    """Return the states of an image or a line scan."""
    if workspace.line_scan_path(name).is_file():
        scan = workspace.line_scan(name).scan
        return _States(scan.camera, scan.positions, scan.axes)
    image = workspace.image(name)
    return _States(image.camera, image.position[None], image.axes[None])


def _largest(vectors: FloatArray) -> FloatArray:
    """Return the longest of vectors (N, 3)."""
    longest: FloatArray = vectors[int(np.argmax(np.linalg.norm(vectors, axis=1)))]
    return longest


def _radius_ratio(first: Workspace, second: Workspace) -> float:
    if not (first.has_shape() and second.has_shape()):
        return float("nan")
    return second.shape().mean_radius / first.shape().mean_radius


def _changed_settings(first: Workspace, second: Workspace) -> dict[str, tuple[Any, Any]]:
    old, new = (each.settings().model_dump(mode="json") for each in (first, second))
    return {
        f"{table}.{key}": (old[table][key], new[table][key])
        for table in old
        for key in old[table]
        if old[table][key] != new[table][key]
    }


def _shift(common: Similarity, centers: FloatArray) -> FloatArray:
    """Return how far the middle of the centres is moved (3,), metres."""
    middle = centers.mean(axis=0)
    return common.apply(middle) - middle


def _percentiles(values: FloatArray) -> dict[str, float] | None:
    """Return percentiles of the known values; None if there is none."""
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    return {f"p{p}": float(np.percentile(known, p)) for p in _PERCENT}
