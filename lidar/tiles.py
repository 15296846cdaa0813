"""Returns of a whole mission, sorted on disk so that each mapola reads only its own.

A scan crosses many mapolas, and a mission has more returns than memory. Each chunk of a scan
is sorted by the nearest of the given centres and appended to one HDF5 table; an index says
which runs of rows belong to which centre. A mapola then reads the runs of the few centres
around it. Memory holds one chunk while writing, and one neighbourhood while reading.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from lidar.returns import Returns
from lidar.scan import Scan
from spcola.arrays import FloatArray, IntArray, frozen
from spcola.atomic import replacing, write_error
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.kernel import kernel

_FORMAT = "spcola tiles 1"
_ROW = np.dtype([("point", "<f8", (3,)), ("sigma", "<f8"), ("scan", "<i4")])
_INDEX = np.dtype([("tile", "<i8"), ("start", "<i8"), ("count", "<i8"), ("extent", "<f8")])
# Rows of an HDF5 chunk: a run of one tile is short, and reading it reads whole chunks.
_CHUNK = 4096


class TileWriter:
    """Write returns sorted by the nearest of `centers`; a context manager.

    The file appears under its name when the block ends without an error, whole.

    Parameters
    ----------
    path : str or Path
        HDF5 file; an older one is replaced.
    centers : (T, 3) array_like
        Centres of the tiles, body-fixed, metres: those of the mapolas to be made.
    radius : float
        Returns further than this from every centre are left out, metres: no mapola asks for
        them.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    InvalidValueError
        If there is no centre, or `radius` is not positive.
    """

    def __init__(self, path: str | Path, centers: ArrayLike, radius: float) -> None:
        self.path = Path(path)
        self.centers = frozen(centers, (None, 3), "centers")
        if len(self.centers) == 0:
            raise InvalidValueError("there is no centre to sort returns by", "centers")
        if not radius > 0:
            raise InvalidValueError(f"must be positive, not {radius} m", "radius")
        self.radius = float(radius)
        self.left_out = 0
        self._tree = cKDTree(self.centers)
        self._names: dict[str, int] = {}
        self._body: str | None = None
        self._index: list[Any] = []
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        temporary = self._stack.enter_context(replacing(self.path))
        try:
            self._file = self._stack.enter_context(h5py.File(temporary, "w"))
            self._rows = self._file.create_dataset(
                "returns", shape=(0,), maxshape=(None,), dtype=_ROW, chunks=(_CHUNK,)
            )
        except BaseException:
            self._stack.close()
            raise
        return self

    def add(self, scan: Scan) -> None:
        """Append a scan, or a chunk of one.

        Raises
        ------
        InvalidValueError
            If it lies in another body-fixed frame than those before.
        WorkspaceError
            If the disk is full.
        """
        if self._body not in (None, scan.body):
            raise InvalidValueError(f"lies in {scan.body}, the others in {self._body}", scan.name)
        self._body = scan.body
        nearest = self._tree.query(scan.points, distance_upper_bound=self.radius)
        distance, tile = np.asarray(nearest[0]), np.asarray(nearest[1])
        order = np.argsort(tile, kind="stable")
        order = order[np.isfinite(distance[order])]
        self.left_out += len(scan) - len(order)
        rows = np.empty(len(order), dtype=_ROW)
        rows["point"] = scan.points[order]
        rows["sigma"] = scan.sigma[order]
        rows["scan"] = self._names.setdefault(scan.name, len(self._names))
        begin = len(self._rows)
        try:
            self._rows.resize((begin + len(rows),))
            self._rows[begin:] = rows
        except OSError as error:
            raise write_error(self.path, error) from error
        self._index.append(_runs(tile[order], distance[order], begin))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            # Written through the stack, so that a failure here removes the temporary file too.
            self._stack.callback(self._finish)
        self._stack.__exit__(kind, error, trace)

    def _finish(self) -> None:
        """Write what is known only at the end."""
        self._file.attrs["format"] = _FORMAT
        self._file.attrs["radius"] = self.radius
        self._file.attrs["body"] = self._body or ""
        self._file["centers"] = self.centers
        self._file["index"] = np.concatenate([np.empty(0, dtype=_INDEX), *self._index])
        self._file["scan_names"] = np.array(list(self._names), dtype=h5py.string_dtype())


def _runs(tile: IntArray, distance: FloatArray, begin: int) -> Any:
    """Index rows of a sorted chunk: tile, first row, rows, and the largest distance in the run."""
    starts = np.flatnonzero(np.diff(tile, prepend=-1))
    runs = np.empty(len(starts), dtype=_INDEX)
    runs["tile"] = tile[starts]
    runs["start"] = begin + starts
    runs["count"] = np.diff(starts, append=len(tile))
    runs["extent"] = np.maximum.reduceat(distance, starts) if len(starts) else 0.0
    return runs


class TileReader:
    """Read back the returns around a place; a context manager, usable from several threads.

    Parameters
    ----------
    path : str or Path
        File of a :class:`TileWriter`.

    Raises
    ------
    WorkspaceError
        If the file cannot be opened.
    FormatError
        If it is something else.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self._file = h5py.File(self.path, "r")
        except OSError as error:
            raise WorkspaceError(
                "cannot be opened as HDF5", self.path, "sort the returns into tiles again"
            ) from error
        try:
            self._read_index()
        except BaseException:
            self._file.close()
            raise

    def _read_index(self) -> None:
        """Check the format and load what is small."""
        if self._file.attrs.get("format") != _FORMAT:
            raise FormatError(f"is not {_FORMAT!r}", self.path, "sort the returns into tiles again")
        self.radius = float(self._file.attrs["radius"])
        self.body = str(self._file.attrs["body"])
        self.scan_names = tuple(self._file["scan_names"].asstr()[:])
        self.centers: FloatArray = self._file["centers"][:]
        self._rows = self._file["returns"]
        index = self._file["index"][:]
        self._index = index[np.argsort(index["tile"], kind="stable")]
        if len(index) and int(np.max(index["start"] + index["count"])) > len(self._rows):
            raise FormatError("the index points past the last return", self.path)

    def __len__(self) -> int:
        return len(self._rows)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def returns_near(self, center: ArrayLike, radius: float) -> Returns:
        """Return all returns within `radius` of `center` (3,), metres; their order is arbitrary.

        Raises
        ------
        InvalidValueError
            If part of that sphere lies where the writer left returns out.
        """
        center = frozen(center, (3,), "center")
        offset = np.linalg.norm(self.centers - center, axis=1)
        if float(offset.min()) + radius > self.radius * (1 + 1e-12):
            raise InvalidValueError(
                f"{radius:g} m around it were not kept whole (kept: {self.radius:g} m around "
                f"the tile centres, the nearest of which is {offset.min():g} m away)",
                "center",
                "sort the returns into tiles again with a larger radius",
            )
        index = self._index
        runs = index[offset[index["tile"]] <= radius + index["extent"]]
        rows = np.empty(int(runs["count"].sum()), dtype=_ROW)
        begin = 0
        for run in runs:
            end = begin + int(run["count"])
            source = np.s_[run["start"] : run["start"] + run["count"]]
            self._rows.read_direct(rows, source, np.s_[begin:end])
            begin = end
        points, sigma, scan = _within(rows["point"], rows["sigma"], rows["scan"], center, radius)
        return Returns(points, sigma, scan, self.scan_names)


@kernel
def _within(
    points: FloatArray, sigma: FloatArray, scan: IntArray, center: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Copy the returns within `radius` of `center` out of rows that lie interleaved on disk."""
    inside = np.empty(len(points), dtype=np.int64)
    count = 0
    for i in range(len(points)):
        x, y, z = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        if x * x + y * y + z * z <= radius * radius:
            inside[count] = i
            count += 1
    kept_points, kept_sigma = np.empty((count, 3)), np.empty(count)
    kept_scan = np.empty(count, dtype=np.int32)
    for k in range(count):
        i = inside[k]
        kept_points[k, 0], kept_points[k, 1], kept_points[k, 2] = points[i]
        kept_sigma[k], kept_scan[k] = sigma[i], scan[i]
    return kept_points, kept_sigma, kept_scan
