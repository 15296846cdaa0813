"""Maplets that contradict their landmarks, the shape or the other maplets.

A .MAP has no checksum. A flipped bit in its header gives a maplet that can be read but has a wrong
place or scale. The header is therefore compared with the landmark of the same name, and heights
with the shape. The limits come from how well most maplets of the solution agree.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fusion.estimation.verdict import Cause, Code, Finding, Severity
from fusion.pipeline.catalog.maplet_facts import (
    COVERED,
    MapletFacts,
    facts_after,
    facts_of,
    maplet_files,
)
from fusion.runtime import content_digest
from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.formats.text import KM

if TYPE_CHECKING:
    from fusion.pipeline.catalog.catalog import Catalog
    from fusion.workspace import Workspace

__all__ = [
    "Judged",
    "Unsound",
    "judged",
    "judged_after",
    "rejected_maplets",
    "unsound",
    "unsound_maplets",
]

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
# A GSD that differs by less than this from one that so many maplets share is an error.
_SHARED, _NEARLY = 3, 1e-3
# Increased whenever other maplets would be found.
_VERSION = 2
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


class Judged(NamedTuple):
    """The unsound maplets of a workspace, and what they were found by.

    Attributes
    ----------
    unsound : tuple of Unsound
    kept : str
        Of the rows of all maplets (:attr:`MapletFacts.kept`).
    """

    unsound: tuple[Unsound, ...]
    kept: str


def unsound_maplets(workspace: Workspace) -> tuple[Unsound, ...]:
    """Return the maplets of a workspace that contradict other files; all are read.

    Frames are compared with those of the landmarks. The limit is the rounding of both files if nine
    of ten agree so well, else ten times the 90th percentile of the misfits. Without a landmark axes
    have to be orthonormal to `AXES_TOLERANCE`. Heights are compared with the shape, if any.

    Raises
    ------
    SpcolaError
        If a file cannot be read.
    """
    return _unsound_of(facts_of(workspace, maplet_files(workspace)))


def judged(workspace: Workspace, catalog: Catalog) -> Judged:
    """Return the result of :func:`unsound_maplets`; only maplets that have changed are read.

    Raises
    ------
    SpcolaError
        If a file cannot be read.
    """
    maplets = maplet_files(workspace)
    landmarks = [one.landmark for one in maplets if one.landmark is not None]
    shape = [workspace.shape_path()] if workspace.has_shape() else []
    digests = catalog.digests([*(one.path for one in maplets), *landmarks, *shape])
    body = workspace.settings().body
    given = [body.shape_unit, body.faces_from, body.icq_edges] if shape else []
    key = content_digest({"version": _VERSION, "files": digests, "shape": given})

    def found() -> dict[str, Any]:
        facts = facts_of(workspace, maplets, digests)
        return {"kept": facts.kept, "unsound": [[u.name, u.why] for u in _unsound_of(facts)]}

    content = catalog.cached("unsound", key, found)
    return Judged(tuple(Unsound(name, why) for name, why in content["unsound"]), content["kept"])


def judged_after(home: Path, kept: str, changes: Iterable[tuple[str, str, str]]) -> Judged | None:
    """Return what :func:`judged` does after some files got other content; None if unknown.

    Parameters
    ----------
    home, kept, changes
        As :func:`facts_after`.

    Raises
    ------
    SpcolaError
        If a maplet cannot be read.
    """
    facts = facts_after(home, kept, changes)
    return None if facts is None else Judged(_unsound_of(facts), facts.kept)


def unsound(workspace: Workspace, catalog: Catalog) -> tuple[Unsound, ...]:
    """Return the unsound maplets of :func:`judged`."""
    return judged(workspace, catalog).unsound


def _unsound_of(facts: MapletFacts) -> tuple[Unsound, ...]:
    """Return the maplets that a check finds, each with what the first one finds."""
    found: dict[str, str] = {}
    for check in (_frames, _axes, _spacings, _sigmas, _heights):
        for place, why in check(facts.rows):
            found.setdefault(facts.names[place], why)
    return tuple(Unsound(name, why) for name, why in found.items())


def _limit(misfits: FloatArray) -> float:
    """Return the limit of misfits in units of the files' rounding: 1 if nine of ten are within."""
    usual = float(np.percentile(misfits, 100.0 * _SHARE, method="lower"))
    return _EXACT if usual <= _EXACT else LOOSE * usual


def _rounding(values: FloatArray | float) -> FloatArray:
    """Return half the distance of a number to the next one of four bytes."""
    half: FloatArray = 0.5 * np.spacing(np.abs(np.asarray(values)).astype(np.float32))
    return half


def _beyond(misfit: FloatArray, places: IntArray) -> Iterator[int]:
    """Yield which of some maplets misfit by more than the limit, of the places of those."""
    if len(misfit):
        yield from places[misfit > _limit(misfit)].tolist()


def _frames(rows: AnyArray) -> Iterator[tuple[int, str]]:
    """Compare V, axes and GSD with those of the landmarks."""
    places = np.flatnonzero(rows["has_landmark"])
    its = rows[places]
    center, other = its["center"] / KM, its["landmark_center"] / KM
    allowed = _rounding(center) + _PRINTED * np.abs(center)
    for place in _beyond(np.max(np.abs(center - other) / allowed, axis=1), places):
        away = float(np.linalg.norm(rows["center"][place] - rows["landmark_center"][place]))
        yield place, f"V lies {away:.3g} m from that of its landmark"
    off = np.abs(its["axes"] - its["landmark_axes"])
    for place in _beyond(np.max(off / (_rounding(its["axes"]) + _PRINTED), axis=(1, 2)), places):
        most = float(np.max(np.abs(rows["axes"][place] - rows["landmark_axes"][place])))
        yield place, f"an axis is off by {most:.2g} from that of its landmark"
    gsd = its["gsd"] / KM
    misfit = np.abs(gsd - its["landmark_gsd"] / KM) / (_rounding(gsd) + _PRINTED * gsd)
    for place in _beyond(misfit, places):
        own, one = rows["gsd"][place], rows["landmark_gsd"][place]
        yield place, f"the GSD is {own:.9g} m, its landmark has {one:.9g}"


def _axes(rows: AnyArray) -> Iterator[tuple[int, str]]:
    """Find axes that are less orthonormal than rounding explains."""
    axes = rows["axes"]
    off = np.max(np.abs(axes @ axes.transpose(0, 2, 1) - np.eye(3)), axis=(1, 2))
    if len(off):
        limit = AXES_TOLERANCE * _limit(off / AXES_TOLERANCE)
        for place in np.flatnonzero(off > limit).tolist():
            yield place, f"its axes are off by {off[place]:.2g} from orthonormal"


def _spacings(rows: AnyArray) -> Iterator[tuple[int, str]]:
    """Find a GSD that is nearly, but not exactly, one that three others share."""
    all_gsd = rows["gsd"].tolist()
    counts = Counter(all_gsd)
    shared = np.array([gsd for gsd, count in counts.items() if count >= _SHARED])
    for place, own in enumerate(all_gsd):
        near = shared[np.abs(own / shared - 1.0) < _NEARLY] if counts[own] == 1 else shared[:0]
        if len(near):
            yield place, f"the GSD is {own:.9g} m, that of others {float(near[0]):.9g}"


def _sigmas(rows: AnyArray) -> Iterator[tuple[int, str]]:
    """Compare sigmas of the centres with those of the landmarks and of all maplets.

    Those of maplets that SPCOLA solved from images are in the sigmas of their heights: they give
    none, a magnitude of 0.
    """
    given = np.flatnonzero((rows["sigma_size"] != 0.0) | ~rows["from_images"])
    its = rows[given]
    paired = its["has_landmark"] & np.all(its["landmark_sigma"] >= 0.0, axis=1)
    places, its = given[paired], its[paired]
    size = np.linalg.norm(its["landmark_sigma"], axis=1)
    off = np.abs(its["sigma_size"] / KM - size / KM)
    of_sizes = off / (_SIGMA_SHARE * size / KM + 1e-30)
    away = np.max(np.abs(its["sigma"] - its["landmark_sigma"]), axis=1, initial=0.0)
    known = np.isfinite(its["sigma"]).all(axis=1)
    of_directions = np.where(known, away / (size / 255.0 + 1e-12), np.inf)
    for misfit in (of_sizes, of_directions):
        for place in _beyond(misfit, places):
            listed = [_listed(rows[one][place]) for one in ("sigma", "landmark_sigma")]
            yield place, f"sigma of V is {listed[0]} m, its landmark has {listed[1]}"
    if not len(given):
        return
    usual = np.median(rows["sigma"][given], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = rows["sigma"][given] / usual
    odd = (usual > 0.0) & ~((ratio > 1.0 / _SIGMA_FACTOR) & (ratio < _SIGMA_FACTOR))
    for place in given[odd.any(axis=1)].tolist():
        own = _listed(rows["sigma"][place])
        yield place, f"sigma of V is {own} m, usual is {_listed(usual)} m"


def _heights(rows: AnyArray) -> Iterator[tuple[int, str]]:
    """Compare heights with the shape: their offset, scatter and scale."""
    covered = rows["seen"] > COVERED
    if not len(rows) or np.mean(covered) < _SHARE:
        return
    chosen = np.flatnonzero(covered)
    for place in np.flatnonzero((rows["seen"] == 0.0) & rows["has_heights"]).tolist():
        yield place, "it does not lie near the shape"
    its = rows[chosen]
    farthest = LOOSE * float(np.percentile(its["offset"], 100.0 * _SHARE, method="lower"))
    most = _most_scatter(its["scatter"])
    for place in chosen.tolist():
        away, rough, gsd = (float(rows[one][place]) for one in ("offset", "scatter", "gsd"))
        if away > max(farthest, gsd):
            yield place, f"its heights lie on average {away:.3g} m from the shape"
        if rough > most:
            yield place, f"its heights scatter by {rough:.3g} m about the shape"
    yield from _gains(its, chosen)


def _most_scatter(scatter: FloatArray) -> float:
    """Return the limit of the scatter of heights about the shape, metres."""
    if len(scatter) < _FEWEST:
        return float("inf")
    sizes = np.log(np.maximum(scatter, 1e-9))
    middle = np.median(sizes)
    spread = 1.4826 * float(np.median(np.abs(sizes - middle)))
    return float(np.exp(middle + max(np.log(MOST_SCATTER), MOST_SIGMAS * spread)))


def _gains(its: AnyArray, places: IntArray) -> Iterator[tuple[int, str]]:
    """Find heights that are too large or too small by a factor, of maplets at these places."""
    scatter, gain = float(np.median(its["scatter"])), its["gain"]
    if len(its) < _FEWEST or not scatter > 0.0:
        return
    away = gain - np.median(gain)
    # The factor cannot be determined from a maplet without relief.
    sigmas = away * its["relief"] / scatter
    spread = 1.4826 * float(np.median(np.abs(sigmas - np.median(sigmas))))
    odd = (np.abs(away) > MOST_GAIN) & (np.abs(sigmas) > MOST_SIGMAS * spread)
    for place in np.flatnonzero(odd).tolist():
        factor = float(gain[place])
        yield places[place], f"its heights are {factor:.4g} times those of the shape"


def _listed(values: FloatArray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


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
