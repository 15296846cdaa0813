"""Parts of .MAP files; large ones are memory mapped, so that only what is asked for is read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError
from spcola.formats.maplets.map import NODE, albedo_of, heights_of
from spcola.formats.maplets.map_header import HEADER, RECORD, check_length, grid_of, header_of
from spcola.formats.maplets.sigma import ORDERS, is_sigma_km, sigma_path
from spcola.formats.text.source import KM, read_bytes, regular_size
from spcola.grids import MapletGrid

# Only larger grids are mapped: those are bigmaps, which this program replaces as a whole. The SPC
# programs rewrite maplets in place, and a mapped file that is cut off kills the process.
_MAPPED = 1501
# Points of a sigma companion that are looked at together, to find its byte order.
_LOOK = 1 << 14


@dataclass(frozen=True, eq=False)
class MapParts:
    """A .MAP file, and the sigma companion next to it, of which parts are read.

    The values are those of :func:`spcola.formats.maplets.read_maplet`.

    Parameters
    ----------
    path : Path
    grid : MapletGrid
        Metres.
    hscale : float
        Quantum of the heights, units of the GSD.

    Examples
    --------
    >>> parts = MapParts.open("bennu/bigmaps/NPOLE.MAP")  # doctest: +SKIP
    >>> parts.read("height", (slice(0, 512), slice(0, 512)))  # doctest: +SKIP
    """

    path: Path
    grid: MapletGrid
    hscale: float

    @classmethod
    def open(cls, path: str | Path) -> MapParts:
        """Read the header of the .MAP file `path`.

        Raises
        ------
        FormatError
            As :func:`spcola.formats.maplets.read_map`.
        """
        path = Path(path)
        content = read_bytes(path, most=RECORD)
        if len(content) < RECORD:
            raise FormatError(f"is truncated: {len(content)} bytes, the header has {RECORD}", path)
        record = np.frombuffer(content, HEADER, count=1)[0]
        check_length(regular_size(path), int(record["half_size"]), path)
        header, _ = header_of(record, path)
        return cls(path, grid_of(record, path), float(header.hscale or 0.0))

    @property
    def has_sigma(self) -> bool:
        """Whether there is a sigma companion."""
        return sigma_path(self.path).is_file()

    def read(self, layer: str, index: tuple[Any, Any]) -> FloatArray:
        """Return part of a layer; NaN where unknown.

        Parameters
        ----------
        layer : {"height", "albedo", "sigma"}
            Height and sigma in metres.
        index : tuple
            Rows (along Uy) and columns (along Ux): slices, or integer arrays (N,).

        Raises
        ------
        FormatError
            If the sigma companion is damaged.
        """
        # The slow index of the file runs along Ux.
        place = (index[1], index[0])
        if layer == "sigma":
            return self._sigma(place).T
        nodes = np.asarray(self._nodes[place])
        if layer == "albedo":
            return albedo_of(nodes).T
        return heights_of(nodes, self.grid.gsd * self.hscale).T

    @cached_property
    def _nodes(self) -> AnyArray:
        return self._mapped(self.path, NODE, RECORD)

    @cached_property
    def _sigmas(self) -> AnyArray:
        """The sigma companion, in the byte order in which all its values are a sigma."""
        path = sigma_path(self.path)
        size = regular_size(path)
        if size != 4 * self.grid.size**2:
            wanted = 4 * self.grid.size**2
            what = f"has {size} bytes, {wanted} belong to q = {self.grid.half_size}"
            raise FormatError(what, path)
        orders = [self._mapped(path, np.dtype(order), 0) for order in ORDERS]
        for part in _pieces(self.grid.size):
            orders = [values for values in orders if is_sigma_km(values[part])]
            if len(orders) < len(ORDERS):
                break
        return self._known_order(orders)

    def _known_order(self, orders: list[AnyArray]) -> AnyArray:
        """Return the first that remains of two byte orders, refused if none does."""
        if not orders:
            raise FormatError(
                "holds values that are no sigma in kilometres",
                sigma_path(self.path),
                "check its byte order",
            )
        return orders[0]

    def _sigma(self, place: tuple[Any, Any]) -> FloatArray:
        values = np.asarray(self._sigmas[place])
        self._known_order([values] if is_sigma_km(values) else [])
        sigma: FloatArray = values.astype(np.float64) * KM
        return sigma

    def _mapped(self, path: Path, kind: np.dtype[Any], offset: int) -> AnyArray:
        try:
            if self.grid.size > _MAPPED:
                return np.memmap(path, kind, "r", offset, self.grid.shape)
            content = read_bytes(path)
            return np.frombuffer(content, kind, self.grid.size**2, offset).reshape(self.grid.shape)
        except (OSError, ValueError) as error:
            raise FormatError(f"cannot be read ({error})", path) from error


def _pieces(size: int) -> Iterator[slice]:
    """Yield slices of rows of a file with `size` points in a row."""
    step = -(-_LOOK // size)
    yield from (slice(first, first + step) for first in range(0, size, step))
