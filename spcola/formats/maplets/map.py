"""Maplets and bigmaps as .MAP files: a header record of 72 bytes, then heights and albedo."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError
from spcola.formats.maplets.map_header import (
    HEADER,
    RECORD,
    MapHeader,
    check_length,
    choose_hscale,
    encode_header,
    grid_of,
    header_of,
    map_length,
)
from spcola.formats.maplets.sigma import read_sigma, sigma_path, write_sigma
from spcola.formats.text.source import KM, read_bytes
from spcola.grids import Maplet

NODE = np.dtype([("height", ">i2"), ("albedo", "u1")])


@dataclass(frozen=True, eq=False)
class MapFile:
    """A maplet with the header of its file."""

    maplet: Maplet
    header: MapHeader


def read_map(path: str | Path, *, name: str | None = None) -> MapFile:
    """Read a .MAP file with its header.

    The file's slow index j runs along Ux and its fast index i along Uy; the maplet's arrays are
    indexed ``[m + q, n + q]`` (rows along Uy), so the data are transposed. A point whose albedo
    byte is 0 is missing: its height and albedo are NaN.

    Parameters
    ----------
    path : str or Path
        The file, in kilometres; the result is in metres.
    name : str, optional
        Name of the maplet; the stem of the file's name if not given.

    Raises
    ------
    FormatError
        If the file is truncated, its length contradicts q, or a field of the header is absurd;
        the message names the bytes.
    """
    content = read_bytes(path)
    if len(content) < RECORD:
        raise FormatError(f"is truncated: {len(content)} bytes, the header has {RECORD}", path)
    record = np.frombuffer(content, HEADER, count=1)[0]
    check_length(len(content), int(record["half_size"]), path)
    grid = grid_of(record, path)
    header, center_sigma = header_of(record, path)
    nodes = np.frombuffer(content, NODE, count=grid.size**2, offset=RECORD)
    maplet = Maplet(
        Path(path).stem if name is None else name,
        grid,
        heights_of(nodes, grid.gsd * float(record["hscale"])).reshape(grid.shape).T,
        albedo_of(nodes).reshape(grid.shape).T,
        center_sigma=center_sigma,
    )
    padding, hidden = content[RECORD + nodes.nbytes :], nodes["albedo"] == 0
    kept = replace(
        header,
        hidden_counts=nodes["height"].tobytes() if nodes["height"][hidden].any() else b"",
        padding=padding if any(padding) else b"",
    )
    return MapFile(maplet, kept)


def heights_of(nodes: AnyArray, quantum: float) -> FloatArray:
    """Return the heights of grid points of a file, in units of `quantum`; NaN where missing."""
    return np.where(nodes["albedo"] == 0, np.nan, nodes["height"]) * quantum


def albedo_of(nodes: AnyArray) -> FloatArray:
    """Return the albedo of grid points of a file; NaN where missing."""
    return np.where(nodes["albedo"] == 0, np.nan, nodes["albedo"] / 100.0)


def read_maplet(path: str | Path, *, name: str | None = None) -> Maplet:
    """Read a .MAP file, and the sigma companion ``NAME.SIG`` next to it if there is one.

    Parameters
    ----------
    path : str or Path
    name : str, optional
        Of the maplet; that of the file if not given.

    Returns
    -------
    Maplet
        Metres; NaN where unknown.

    Raises
    ------
    FormatError
        As :func:`read_map` and :func:`read_sigma`.
    """
    maplet = read_map(path, name=name).maplet
    companion = sigma_path(path)
    if not companion.exists():
        return maplet
    return maplet.with_layers(sigma=read_sigma(companion, maplet.grid.half_size))


def write_maplet(
    path: str | Path,
    maplet: Maplet,
    *,
    header: MapHeader | None = None,
    sigma_companion: bool = False,
) -> None:
    """Write a maplet or bigmap as a .MAP file.

    Heights are stored as 16-bit counts of ``hscale`` times the GSD. The header's hscale is kept
    while it reproduces the heights; otherwise it is max(1, max|h|) / 30000, h in units of the
    GSD, so that no height can overflow. Albedo is stored in hundredths, 0.01 … 2.55 (values
    beyond are clipped; a valid point is never given byte 0, which means missing); an unknown
    albedo at a valid point is stored as 1. An unknown position uncertainty is stored as 0.

    Parameters
    ----------
    path : str or Path
        Written whole or not at all.
    maplet : Maplet
        Metres.
    header : MapHeader, optional
        From :func:`read_map`, to be kept.
    sigma_companion : bool
        Also write the heights' sigma to ``NAME.SIG`` next to it.

    Raises
    ------
    InvalidValueError
        If the frame does not fit the format (q above 65535, ``|V|``, GSD; see
        :func:`spcola.formats.text.source.check_grid_km`), or a height exceeds 3e8 GSD.
    WorkspaceError
        If the file cannot be written.
    """
    atomic.write_bytes(path, map_content(maplet, header))
    if sigma_companion:
        write_sigma(sigma_path(path), maplet.sigma)


def map_content(maplet: Maplet, header: MapHeader | None = None) -> bytes:
    """Return the content that :func:`write_maplet` writes, or raise its InvalidValueError."""
    header = header or MapHeader()
    record = encode_header(maplet, header)
    heights = maplet.height.T.ravel() / (float(record["gsd"][0]) * KM)
    record["hscale"] = choose_hscale(heights, header.hscale, maplet.name)
    nodes = _nodes(heights / float(record["hscale"][0]), maplet, header)
    body = record.tobytes() + nodes.tobytes()
    room = map_length(maplet.grid.half_size) - len(body)
    padding = header.padding if len(header.padding) == room else bytes(room)
    return body + padding


def _nodes(counts: FloatArray, maplet: Maplet, header: MapHeader) -> AnyArray:
    """Return the grid points as the file stores them, from height counts in its order."""
    missing = np.isnan(counts)
    nodes = np.zeros(len(counts), NODE)
    hidden = np.frombuffer(header.hidden_counts, ">i2")
    nodes["height"] = np.where(
        missing, hidden if len(hidden) == len(counts) else 0, np.rint(np.nan_to_num(counts))
    )
    albedo = np.nan_to_num(maplet.albedo.T.ravel(), nan=1.0, posinf=2.55, neginf=0.01)
    nodes["albedo"] = np.where(missing, 0, np.clip(np.rint(albedo * 100.0), 1, 255))
    return nodes
