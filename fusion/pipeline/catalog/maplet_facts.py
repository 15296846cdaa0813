"""What the soundness of maplets is judged by: a row of numbers for each, kept until it changes.

To read a maplet and its landmark takes most of the time of a judgement. The numbers are therefore
kept by the digests of both files, so that only those are read again that have changed.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fusion.runtime import content_digest
from spcola import atomic
from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.errors import SpcolaError
from spcola.formats.image_sigmas import slope_sigma_path
from spcola.formats.maplets import read_map
from spcola.formats.solution import read_landmark
from spcola.formats.text import KM
from spcola.grids import Maplet

if TYPE_CHECKING:
    from fusion.workspace import Workspace
    from spcola.shape import RayCaster

__all__ = [
    "COVERED",
    "ROW",
    "MapletFacts",
    "MapletFiles",
    "facts_after",
    "facts_of",
    "maplet_files",
]

_FILE = "provenance/.maplets"
_DIGEST_BYTES = 64
# Rays to the shape along half a side of a maplet.
_RAYS = 6
COVERED = 0.5
"""Heights are compared with the shape where more of them than this share have it below."""
# What is kept with a row: the name of its maplet, and the digests of what it depends on.
_OF = ("name", "map", "landmark", "shape")
_NUMBERS: list[Any] = [
    ("center", "f8", (3,)),
    ("axes", "f8", (3, 3)),
    ("gsd", "f8"),
    ("sigma", "f8", (3,)),
    ("sigma_size", "f8"),
    ("from_images", "?"),
    ("has_landmark", "?"),
    ("landmark_center", "f8", (3,)),
    ("landmark_axes", "f8", (3, 3)),
    ("landmark_gsd", "f8"),
    ("landmark_sigma", "f8", (3,)),
    ("has_heights", "?"),
    ("seen", "f8"),
    ("offset", "f8"),
    ("scatter", "f8"),
    ("relief", "f8"),
    ("gain", "f8"),
]
ROW = np.dtype(_NUMBERS)
"""Numbers of a maplet: metres, and of its landmark if it `has_landmark`.

`sigma_size` is the magnitude of the sigma in the file; maplets solved `from_images` by SPCOLA, next
to which a .SSG lies, give none. Of heights above the shape: the share that
was `seen` there, and where that is over one half the size of their mean (`offset`), their standard
deviation (`scatter`), that of the shape's own heights (`relief`), and the slope of the regression
of the maplet's heights on these (`gain`); NaN elsewhere.
"""


class MapletFacts(NamedTuple):
    """Rows of the maplets of a workspace.

    Attributes
    ----------
    names : list of str
    rows : (N,) ndarray of `ROW`
    kept : str
        Digest of the file that keeps them; empty if they are not kept.
    """

    names: list[str]
    rows: AnyArray
    kept: str = ""


@dataclass(frozen=True)
class MapletFiles:
    """Files of a maplet that its soundness depends on.

    Attributes
    ----------
    name : str
    path : Path
        The .MAP.
    landmark : Path or None
        Its existing landmark file.
    """

    name: str
    path: Path
    landmark: Path | None


def maplet_files(workspace: Workspace) -> list[MapletFiles]:
    """Return the files of all maplets of a workspace, without those that are left out."""
    landmarks = set(workspace.landmark_names())
    found = []
    for name in workspace.maplet_names():
        landmark = workspace.landmark_path(name) if name in landmarks else None
        there = landmark is not None and landmark.is_file()
        found.append(MapletFiles(name, workspace.maplet_path(name), landmark if there else None))
    return found


def facts_of(
    workspace: Workspace,
    maplets: Sequence[MapletFiles],
    digests: Mapping[str, str] | None = None,
) -> MapletFacts:
    """Return the rows of maplets; of those that are kept the files are not read again.

    Parameters
    ----------
    workspace : Workspace
    maplets : sequence of MapletFiles
    digests : mapping of str to str, optional
        Of their files, and of the shape if there is one, by their names in the catalogue. Without
        them nothing is kept, and all is read.

    Raises
    ------
    SpcolaError
        If a maplet cannot be read.
    """
    names = [one.name for one in maplets]
    if digests is None:
        return MapletFacts(names, np.array(list(_read(maplets, _caster(workspace))), ROW))
    now = np.empty(len(maplets), _kept_type(names))
    relative = workspace.relative
    now["name"] = [name.encode("utf-8", "surrogateescape") for name in names]
    now["map"] = [digests[relative(one.path)] for one in maplets]
    now["landmark"] = [digests[relative(one.landmark)] if one.landmark else "" for one in maplets]
    now["shape"] = _shape_digest(workspace, maplets, digests)
    path = workspace.home / _FILE
    before, kept = _load(path)
    if all(np.array_equal(before[one], now[one]) for one in _OF):
        return MapletFacts(names, before["row"], kept)
    places = _places(before, now)
    there = np.flatnonzero(places >= 0)
    now["row"][there] = before["row"][places[there]]
    if lacking := np.flatnonzero(places < 0).tolist():
        read = _read([maplets[place] for place in lacking], _caster(workspace))
        now["row"][lacking] = np.array(list(read), ROW)
    return MapletFacts(names, now["row"], _store(path, now))


def facts_after(
    home: Path, kept: str, changes: Iterable[tuple[str, str, str]]
) -> MapletFacts | None:
    """Return the rows of the maplets after some of their files got other content.

    Without opening the workspace, which takes longer.

    Parameters
    ----------
    home : Path
        Folder of the solution.
    kept : str
        Of the rows before (:attr:`MapletFacts.kept`).
    changes : iterable of (str, str, str)
        Name in the catalogue, digest before, and digest now of each .MAP and .LMK that changed.

    Returns
    -------
    MapletFacts or None
        None if these rows are not kept, or there is a shape, which would have to be read.

    Raises
    ------
    SpcolaError
        If a maplet cannot be read.
    """
    table, found = _load(home / _FILE)
    if not kept or found != kept or np.any(table["shape"] != b""):
        return None
    names = [name.decode("utf-8", "surrogateescape") for name in table["name"].tolist()]
    places, changed = {name: place for place, name in enumerate(names)}, set[int]()
    for file, before, now in changes:
        column = "map" if file.startswith("MAPFILES/") else "landmark"
        place = places.get(Path(file).stem)
        # What no maplet of the solution is judged by: those that are left off its list.
        if place is None or table[column][place] == b"":
            continue
        if table[column][place] != before.encode():
            return None
        table[column][place] = now
        changed.add(place)
    if not changed:
        return MapletFacts(names, table["row"], kept)
    there = sorted(changed)
    files = [
        MapletFiles(
            names[place],
            home / "MAPFILES" / f"{names[place]}.MAP",
            home / "LMKFILES" / f"{names[place]}.LMK" if table["landmark"][place] else None,
        )
        for place in there
    ]
    table["row"][there] = np.array(list(_read(files, None)), ROW)
    return MapletFacts(names, table["row"], _store(home / _FILE, table))


def _kept_type(names: Iterable[str]) -> np.dtype[Any]:
    """Return the type of what is kept: a row with the digests of all that it depends on."""
    longest = max((len(name.encode("utf-8", "surrogateescape")) for name in names), default=1)
    text = f"S{_DIGEST_BYTES}"
    return np.dtype(
        [("name", f"S{longest}"), ("map", text), ("landmark", text), ("shape", text), ("row", ROW)]
    )


def _shape_digest(
    workspace: Workspace, maplets: Sequence[MapletFiles], digests: Mapping[str, str]
) -> str:
    """Return a digest of all that heights of the shape depend on; empty without a shape."""
    if not workspace.has_shape():
        return ""
    path, body = workspace.shape_path(), workspace.settings().body
    # Whether the unit fits is judged by the first maplet.
    first = [digests[workspace.relative(one.path)] for one in maplets[:1]]
    given = [body.shape_unit, body.faces_from, body.icq_edges]
    return content_digest([digests[workspace.relative(path)], *first, *given])


def _places(before: AnyArray, now: AnyArray) -> IntArray:
    """Return where the row of each maplet is among those before; −1 if its files are others."""
    known = {key: place for place, key in enumerate(_contents(before))}
    return np.array([known.get(key, -1) for key in _contents(now)], np.int64)


def _contents(table: AnyArray) -> Iterator[tuple[bytes, ...]]:
    """Yield for each maplet the digests of all that its row depends on."""
    return zip(*(table[one].tolist() for one in _OF[1:]), strict=True)


def _load(path: Path) -> tuple[AnyArray, str]:
    """Return what is kept, and its digest; nothing if it is damaged or of another version."""
    try:
        content = path.read_bytes()
        checksum, data = content[:_DIGEST_BYTES].decode("ascii"), content[_DIGEST_BYTES:]
        if checksum == hashlib.sha256(data).hexdigest():
            found: AnyArray = np.load(io.BytesIO(data), allow_pickle=False)
            if found.ndim == 1 and found.dtype.names == (*_OF, "row") and found.dtype["row"] == ROW:
                return found, checksum
    except (OSError, ValueError):
        pass
    return np.empty(0, _kept_type([])), ""


def _store(path: Path, table: AnyArray) -> str:
    """Keep a table; return its digest. Where that fails nothing is lost but time."""
    stream = io.BytesIO()
    np.save(stream, table, allow_pickle=False)
    checksum = hashlib.sha256(stream.getbuffer()).hexdigest()
    with suppress(SpcolaError, OSError):
        path.parent.mkdir(exist_ok=True)
        atomic.write_bytes(path, checksum.encode() + stream.getvalue())
        return checksum
    return ""


def _read(maplets: Iterable[MapletFiles], caster: RayCaster | None) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of maplets from their files."""
    for one in maplets:
        read = read_map(one.path, name=one.name)
        grid, landmark = read.maplet.grid, None
        if one.landmark is not None:
            # The stage that needs a landmark reports one that cannot be read.
            with suppress(SpcolaError):
                landmark = read_landmark(one.landmark)
        # Where there is no landmark, the numbers of the maplet fill its place.
        other = grid if landmark is None else landmark.grid
        sigma = read.maplet.center_sigma
        yield (
            grid.center, grid.axes, grid.gsd, sigma, read.header.sigma_size_km * KM,
            slope_sigma_path(one.path).is_file(),
            landmark is not None, other.center, other.axes, other.gsd,
            sigma if landmark is None else landmark.sigma,
            *_above_shape(read.maplet, caster),
        )  # fmt: skip


def _caster(workspace: Workspace) -> RayCaster | None:
    """Return a ray caster of the shape; None if there is no readable shape."""
    from spcola.shape import RayCaster  # noqa: PLC0415  # slow to import: only with a shape

    try:
        return RayCaster(workspace.shape()) if workspace.has_shape() else None
    except SpcolaError:
        # The stages that need the shape report what is wrong with it.
        return None


def _above_shape(
    maplet: Maplet, caster: RayCaster | None
) -> tuple[bool, float, float, float, float, float]:
    """Return whether some heights are known, and how they lie above the shape."""
    grid, nan = maplet.grid, float("nan")
    step = max(1, grid.half_size // _RAYS)
    reach = grid.half_size // step
    kept = slice(grid.half_size - reach * step, grid.half_size + reach * step + 1, step)
    height = maplet.height[kept, kept]
    has_heights = bool(np.isfinite(height).any())
    if caster is None:
        return has_heights, 0.0, nan, nan, nan, nan
    from spcola.shape import shape_heights  # noqa: PLC0415  # slow to import: only with a shape

    coarse = replace(grid, gsd=grid.gsd * step, half_size=reach)
    shape = shape_heights(caster, coarse, reach=2.0 * coarse.radius)
    both = np.isfinite(height) & np.isfinite(shape)
    seen = float(both.mean())
    if not seen > COVERED:
        return has_heights, seen, nan, nan, nan, nan
    over, under = height[both], shape[both]
    gap = over - under
    offset, scatter = float(abs(np.mean(gap))), float(np.std(gap))
    return has_heights, seen, offset, scatter, float(np.std(under)), _gain(under, over)


def _gain(shape: FloatArray, height: FloatArray) -> float:
    """Return the slope of the regression of heights on those of the shape."""
    flat = shape - shape.mean()
    return float(np.sum(flat * (height - height.mean())) / max(np.sum(flat**2), 1e-300))
