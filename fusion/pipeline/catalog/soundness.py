"""Maplets that contradict their landmarks, the shape or the other maplets.

A .MAP has no checksum. A flipped bit in its header gives a maplet that can be read but has a wrong
place or scale. The header is therefore compared with the landmark of the same name, and heights
with the shape. The limits come from how well most maplets of the solution agree.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.estimation.verdict import Cause, Code, Finding, Severity
from fusion.pipeline.catalog.catalog import Catalog
from fusion.runtime import content_digest
from fusion.workspace import Workspace
from spcola.arrays import BoolArray, FloatArray
from spcola.control import Landmark
from spcola.errors import SpcolaError
from spcola.formats.maplets import read_map
from spcola.formats.text import KM
from spcola.grids import MapletGrid
from spcola.shape import RayCaster, shape_heights

AXES_TOLERANCE = 3e-7
"""Scalar products of axes that were rounded to four bytes differ by less from 0 and 1."""
LOOSE = 10.0
"""Limit if files do not agree to their rounding: times the 90th percentile of the misfits."""
MOST_GAIN = 0.02
"""Largest relative error of a maplet's heights against the shape, if others scatter less."""
MOST_SIGMAS = 8.0
"""... or so many robust standard deviations of all maplets of the solution."""
MOST_SCATTER = 3.0
"""Largest scatter of heights about the shape relative to the median, if others vary less."""
_EXACT = 1.01
_SHARE = 0.9
# Sigmas are stored in bytes: a map that is read and written again has slightly smaller ones.
_SIGMA_SHARE = 0.01
_SIGMA_FACTOR = 1e3
# Landmark files have ten digits, and unit vectors are normalised when they are read.
_PRINTED = 1e-9
# Rays to the shape along half a side of a maplet.
_RAYS = 6
# A GSD that differs by less than this from one that so many maplets share is an error.
_SHARED, _NEARLY = 3, 1e-3
# Increased whenever other maplets would be found.
_VERSION = 1
# The scatter of fewer maplets is not known.
_FEWEST = 5
# In a registration.json of before `cause`.
_OLD_REASON = "disagrees with the other mapolas"


@dataclass(frozen=True)
class Unsound:
    """A maplet that contradicts other files, and why: one clause with numbers."""

    name: str
    why: str

    @property
    def text(self) -> str:
        """The file and what is wrong with it."""
        return f"MAPFILES/{self.name}.MAP: {self.why}"

    def left_out(self) -> Finding:
        """Return a finding about a result that was made without the maplet."""
        text = f"MAPFILES/{self.name}.MAP was left out: {self.why}"
        return Finding(Code.UNSOUND_MAPLET, Severity.NOTE, text)


@dataclass(frozen=True, eq=False)
class _Stated:
    """One maplet, its landmark, and the heights that are compared.

    Attributes
    ----------
    name : str
    grid : MapletGrid
    sigma : (3,) ndarray
        Sigmas of its centre, metres; NaN if not stated.
    sigma_size : float
        Magnitude of the sigma in the file, metres.
    landmark : Landmark or None
    height, shape : (K, K) ndarray
        Heights of some grid points, of the maplet and the shape, metres; NaN where unknown.
    """

    name: str
    grid: MapletGrid
    sigma: FloatArray
    sigma_size: float
    landmark: Landmark | None
    height: FloatArray
    shape: FloatArray


def unsound_maplets(workspace: Workspace) -> tuple[Unsound, ...]:
    """Return the maplets of a workspace that contradict other files.

    Frames are compared with those of the landmarks. The limit is the rounding of both files if nine
    of ten agree so well, else ten times the 90th percentile of the misfits. Without a landmark axes
    have to be orthonormal to `AXES_TOLERANCE`. Heights are compared with the shape, if any.

    Raises
    ------
    SpcolaError
        If a file cannot be read.
    """
    names = workspace.maplet_names()
    landmarks = set(workspace.landmark_names())
    caster = _caster(workspace)
    stated = [_stated(workspace, name, name in landmarks, caster) for name in names]
    found: dict[str, str] = {}
    for check in (_frames, _axes, _spacings, _sigmas, _heights):
        for name, why in check(stated):
            found.setdefault(name, why)
    return tuple(Unsound(name, why) for name, why in found.items())


def soundness_files(workspace: Workspace) -> list[Path]:
    """Return the files that :func:`unsound_maplets` reads."""
    maplets = [workspace.maplet_path(name) for name in workspace.maplet_names()]
    known = {path.stem for path in maplets}
    landmarks = [workspace.landmark_path(n) for n in workspace.landmark_names() if n in known]
    shape = [workspace.shape_path()] if workspace.has_shape() else []
    return [*maplets, *(path for path in landmarks if path.is_file()), *shape]


def _caster(workspace: Workspace) -> RayCaster | None:
    """Return a ray caster of the shape; None if there is no readable shape."""
    try:
        return RayCaster(workspace.shape()) if workspace.has_shape() else None
    except SpcolaError:
        # The stages that need the shape report what is wrong with it.
        return None


def _stated(
    workspace: Workspace, name: str, has_landmark: bool, caster: RayCaster | None
) -> _Stated:
    """Read one maplet and what it is compared with."""
    read = read_map(workspace.maplet_path(name), name=name)
    maplet, grid, landmark = read.maplet, read.maplet.grid, None
    if has_landmark and workspace.landmark_path(name).is_file():
        # The stage that needs a landmark reports one that cannot be read.
        with suppress(SpcolaError):
            landmark = workspace.landmark(name)
    step = max(1, grid.half_size // _RAYS)
    reach = grid.half_size // step
    kept = slice(grid.half_size - reach * step, grid.half_size + reach * step + 1, step)
    height = maplet.height[kept, kept]
    shape = np.full(height.shape, np.nan)
    if caster is not None:
        coarse = replace(grid, gsd=grid.gsd * step, half_size=reach)
        shape = shape_heights(caster, coarse, reach=2.0 * coarse.radius)
    size = read.header.sigma_size_km * KM
    return _Stated(name, grid, maplet.center_sigma, size, landmark, height, shape)


def _limit(misfits: FloatArray) -> float:
    """Return the limit of misfits in units of the files' rounding: 1 if nine of ten are within."""
    usual = float(np.percentile(misfits, 100.0 * _SHARE, method="lower"))
    return _EXACT if usual <= _EXACT else LOOSE * usual


def _rounding(values: FloatArray | float) -> FloatArray:
    """Return half the distance of a number to the next one of four bytes."""
    half: FloatArray = 0.5 * np.spacing(np.abs(np.asarray(values)).astype(np.float32))
    return half


def _misfits(
    stated: Sequence[_Stated], misfit: Callable[[_Stated, Landmark], float]
) -> Iterator[tuple[_Stated, Landmark]]:
    """Yield the maplets that misfit their landmarks by more than the limit."""
    pairs = [(one, one.landmark) for one in stated if one.landmark is not None]
    if not pairs:
        return
    found = np.array([misfit(one, landmark) for one, landmark in pairs])
    limit = _limit(found)
    yield from (pair for pair, value in zip(pairs, found, strict=True) if value > limit)


def _frames(stated: Sequence[_Stated]) -> Iterator[tuple[str, str]]:
    """Compare V, axes and GSD with those of the landmarks."""

    def of_centers(one: _Stated, landmark: Landmark) -> float:
        center = one.grid.center / KM
        allowed = _rounding(center) + _PRINTED * np.abs(center)
        return float(np.max(np.abs(center - landmark.grid.center / KM) / allowed))

    def of_axes(one: _Stated, landmark: Landmark) -> float:
        allowed = _rounding(one.grid.axes) + _PRINTED
        return float(np.max(np.abs(one.grid.axes - landmark.grid.axes) / allowed))

    def of_spacings(one: _Stated, landmark: Landmark) -> float:
        gsd = one.grid.gsd / KM
        return float(abs(gsd - landmark.grid.gsd / KM) / (_rounding(gsd) + _PRINTED * gsd))

    for one, landmark in _misfits(stated, of_centers):
        away = float(np.linalg.norm(one.grid.center - landmark.grid.center))
        yield one.name, f"V lies {away:.3g} m from that of its landmark"
    for one, landmark in _misfits(stated, of_axes):
        off = float(np.max(np.abs(one.grid.axes - landmark.grid.axes)))
        yield one.name, f"an axis is off by {off:.2g} from that of its landmark"
    for one, landmark in _misfits(stated, of_spacings):
        yield one.name, f"the GSD is {one.grid.gsd:.9g} m, its landmark has {landmark.grid.gsd:.9g}"


def _axes(stated: Sequence[_Stated]) -> Iterator[tuple[str, str]]:
    """Find axes that are less orthonormal than rounding explains."""
    off = np.array([np.max(np.abs(one.grid.axes @ one.grid.axes.T - np.eye(3))) for one in stated])
    if len(off):
        limit = AXES_TOLERANCE * _limit(off / AXES_TOLERANCE)
        for one, value in zip(stated, off, strict=True):
            if value > limit:
                yield one.name, f"its axes are off by {value:.2g} from orthonormal"


def _spacings(stated: Sequence[_Stated]) -> Iterator[tuple[str, str]]:
    """Find a GSD that is nearly, but not exactly, one that three others share."""
    counts = Counter(one.grid.gsd for one in stated)
    shared = np.array([gsd for gsd, count in counts.items() if count >= _SHARED])
    for one in stated:
        near = np.abs(one.grid.gsd / shared - 1.0) < _NEARLY if len(shared) else np.array([])
        if counts[one.grid.gsd] == 1 and near.any():
            other = float(shared[near][0])
            yield one.name, f"the GSD is {one.grid.gsd:.9g} m, that of others {other:.9g}"


def _sigmas(stated: Sequence[_Stated]) -> Iterator[tuple[str, str]]:
    """Compare sigmas of the centres with those of the landmarks and of all maplets."""
    known = [
        replace(one, landmark=None)
        if one.landmark is None or not np.all(one.landmark.sigma >= 0.0)
        else one
        for one in stated
    ]

    def of_sizes(one: _Stated, landmark: Landmark) -> float:
        size, other = one.sigma_size / KM, float(np.linalg.norm(landmark.sigma)) / KM
        return float(abs(size - other) / (_SIGMA_SHARE * other + 1e-30))

    def of_directions(one: _Stated, landmark: Landmark) -> float:
        if not np.isfinite(one.sigma).all():
            return float("inf")
        allowed = float(np.linalg.norm(landmark.sigma)) / 255.0 + 1e-12
        return float(np.max(np.abs(one.sigma - landmark.sigma)) / allowed)

    for misfit in (of_sizes, of_directions):
        for one, landmark in _misfits(known, misfit):
            yield (
                one.name,
                f"sigma of V is {_listed(one.sigma)} m, its landmark has "
                + _listed(landmark.sigma),
            )
    usual = np.median([one.sigma for one in stated], axis=0) if stated else np.zeros(3)
    for one in stated:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = one.sigma / usual
        if np.any((usual > 0.0) & ~((ratio > 1.0 / _SIGMA_FACTOR) & (ratio < _SIGMA_FACTOR))):
            yield one.name, f"sigma of V is {_listed(one.sigma)} m, usual is {_listed(usual)} m"


def _heights(stated: Sequence[_Stated]) -> Iterator[tuple[str, str]]:
    """Compare heights with the shape: their offset, scatter and scale."""
    both = [np.isfinite(one.height) & np.isfinite(one.shape) for one in stated]
    seen = np.array([mask.mean() for mask in both])
    if not len(seen) or np.mean(seen > 0.5) < _SHARE:
        return
    for one, share in zip(stated, seen, strict=True):
        if share == 0.0 and np.isfinite(one.height).any():
            yield one.name, "it does not lie near the shape"
    chosen = [(one, mask) for one, mask in zip(stated, both, strict=True) if mask.mean() > 0.5]
    gaps = [one.height[mask] - one.shape[mask] for one, mask in chosen]
    offset = np.array([abs(np.mean(gap)) for gap in gaps])
    farthest = LOOSE * float(np.percentile(offset, 100.0 * _SHARE, method="lower"))
    scatter = np.array([np.std(gap) for gap in gaps])
    most = _most_scatter(scatter)
    for (one, _), away, rough in zip(chosen, offset, scatter, strict=True):
        if away > max(farthest, one.grid.gsd):
            yield one.name, f"its heights lie on average {away:.3g} m from the shape"
        if rough > most:
            yield one.name, f"its heights scatter by {rough:.3g} m about the shape"
    yield from _gains(chosen, float(np.median(scatter)))


def _most_scatter(scatter: FloatArray) -> float:
    """Return the limit of the scatter of heights about the shape, metres."""
    if len(scatter) < _FEWEST:
        return float("inf")
    sizes = np.log(np.maximum(scatter, 1e-9))
    middle = np.median(sizes)
    spread = 1.4826 * float(np.median(np.abs(sizes - middle)))
    return float(np.exp(middle + max(np.log(MOST_SCATTER), MOST_SIGMAS * spread)))


def _gains(
    chosen: Sequence[tuple[_Stated, BoolArray]], scatter: float
) -> Iterator[tuple[str, str]]:
    """Find heights that are too large or too small by a factor.

    `scatter` is the median over all maplets of the scatter of heights about the shape, metres.
    """
    relief = np.array([np.std(one.shape[mask]) for one, mask in chosen])
    if len(relief) < _FEWEST or not scatter > 0.0:
        return
    gain = np.array([_gain(one.shape[mask], one.height[mask]) for one, mask in chosen])
    away = gain - np.median(gain)
    # The factor cannot be determined from a maplet without relief.
    sigmas = away * relief / scatter
    spread = 1.4826 * float(np.median(np.abs(sigmas - np.median(sigmas))))
    for (one, _), factor, far, size in zip(chosen, gain, away, sigmas, strict=True):
        if abs(far) > MOST_GAIN and abs(size) > MOST_SIGMAS * spread:
            yield one.name, f"its heights are {factor:.4g} times those of the shape"


def _gain(shape: FloatArray, height: FloatArray) -> float:
    """Return the slope of the regression of heights on those of the shape."""
    flat = shape - shape.mean()
    return float(np.sum(flat * (height - height.mean())) / max(np.sum(flat**2), 1e-300))


def _listed(values: FloatArray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def unsound(workspace: Workspace, catalog: Catalog) -> tuple[Unsound, ...]:
    """Return the result of :func:`unsound_maplets`, computed once as long as no file changes."""
    files = catalog.digests(soundness_files(workspace))
    key = content_digest({"version": _VERSION, "files": files})

    def found() -> list[list[str]]:
        return [[one.name, one.why] for one in unsound_maplets(workspace)]

    return tuple(Unsound(name, why) for name, why in catalog.cached("unsound", key, found))


def _is_outlier(entry: Mapping[str, Any]) -> bool:
    """Return whether a mapola was matched, but left out; older files have no code."""
    if "cause" in entry:
        return entry["cause"] == Cause.OUTLIER
    return entry.get("reason") == _OLD_REASON


def rejected_maplets(workspace: Workspace) -> list[Finding]:
    """Return a note on the maplets that the registration rejected as contradicting the others."""
    if not workspace.registration_path.is_file():
        return []
    content = workspace.read_json(workspace.registration_path.name)
    known = set(workspace.maplet_names())
    names = [
        str(entry.get("name"))
        for entry in content.get("per_mapola") or ()
        if not entry.get("used") and _is_outlier(entry) and entry.get("name") in known
    ]
    if not names:
        return []
    text = f"the registration left out {', '.join(names)} ({Cause.OUTLIER.meaning})"
    return [Finding(Code.REJECTED_MAPLET, Severity.NOTE, text, float(len(names)))]
