"""What a file is, among all that SPCOLA reads: by its name, else by its content."""

from __future__ import annotations

import re
from enum import StrEnum
from pathlib import Path

from fusion.fusing.maplets import FUSED_HDF5
from fusion.inspection.foreign import name_content
from fusion.workspace import SPC_LISTS
from lidar.formats import recognise
from lidar.formats.mapolas import ADJUSTMENT_HDF5, MAPOLAS_HDF5
from spcola.errors import FormatError, WorkspaceError
from spcola.formats.shapes import recognise_shape
from spcola.formats.shapes.ply import parse_header
from spcola.formats.solution.line_scan import LINE_SCAN_SUFFIX, is_line_scan
from spcola.formats.text import read_bytes

# Comments before the first data block of a kernel are shorter than this, bytes.
_HEAD = 1 << 17
_RESULTS = (MAPOLAS_HDF5, FUSED_HDF5, ADJUSTMENT_HDF5)
# Length of a block of a FITS file, which the first cards of its header stand in, bytes.
_FITS_BLOCK = 2880


class FileKind(StrEnum):
    """What a file is, among all that SPCOLA reads."""

    MAPLET = "maplet"
    LANDMARK = "landmark"
    SUMMARY = "image summary"
    IMAGE = "image"
    LINE_SCAN = "line-scan image"
    NOMINAL = "nominal state"
    LIST = "list"
    SETTINGS = "settings"
    JSON = "JSON"
    FITS = "FITS terrain model"
    GEOTIFF = "GeoTIFF terrain model"
    KERNEL = "SPICE kernel"
    SHAPE = "shape"
    LIDAR = "lidar"


_SUFFIXES = {
    ".map": FileKind.MAPLET,
    ".lmk": FileKind.LANDMARK,
    ".sum": FileKind.SUMMARY,
    ".nom": FileKind.NOMINAL,
    ".toml": FileKind.SETTINGS,
    ".json": FileKind.JSON,
    ".tif": FileKind.GEOTIFF,
    **dict.fromkeys((".cub", ".img", ".lbl", ".xml", ".png"), FileKind.IMAGE),
}


def file_kind(path: Path) -> FileKind:
    """Return what a file is: by its suffix one of SPC or of a workspace, else by its content.

    Image data (.DAT) are recognised by the .SUM file around them: see :func:`summary_path`.

    Raises
    ------
    FormatError
        If it is none of them, with what it is instead.
    WorkspaceError
        If there is no such file.
    """
    _check_there(path)
    if path.name in SPC_LISTS:
        return FileKind.LIST
    suffix = path.suffix.lower()
    if suffix in _SUFFIXES:
        return _SUFFIXES[suffix]
    if suffix in (".fits", ".fit"):
        return FileKind.IMAGE if _is_plane(path) else FileKind.FITS
    if suffix == LINE_SCAN_SUFFIX and is_line_scan(path):
        return FileKind.LINE_SCAN
    if suffix == ".dat" and summary_path(path) is not None:
        return FileKind.IMAGE
    return _kind_by_content(path)


def _kind_by_content(path: Path) -> FileKind:
    """Return what a file is of no known suffix."""
    if _is_kernel(path):
        return FileKind.KERNEL
    try:
        form = recognise_shape(path)
    except FormatError:
        lidar_format(path)
        return FileKind.LIDAR
    return FileKind.LIDAR if form == "ply" and not _has_faces(path) else FileKind.SHAPE


def summary_path(pixels: Path) -> Path | None:
    """Return the .SUM file of an image, in its own folder or in SUMFILES next to that; or None."""
    name = f"{pixels.stem}.SUM"
    for folder in (pixels.parent, pixels.absolute().parent.parent / "SUMFILES"):
        if (folder / name).is_file():
            return folder / name
    return None


def lidar_format(path: Path) -> str:
    """Return the format of a lidar file.

    Raises
    ------
    FormatError
        If it is none; with what the file is, and which command takes it.
    """
    if read_bytes(path, most=3) == b"ply":
        return "cloud"
    try:
        return recognise(path)
    except FormatError as error:
        head = read_bytes(path, most=_HEAD)
        if not head:
            raise
        what, advice = name_content(head)
        raise FormatError(f"is {what}", path, advice) from error


def _check_there(path: Path) -> None:
    """Refuse what is not there, no regular file, or a part of a workspace's result."""
    if not path.exists():
        raise WorkspaceError("is not there", path)
    if not path.is_file():
        raise WorkspaceError(
            "is a pipe or a device, not a regular file", path, "write its content to a file first"
        )
    if path.name in _RESULTS:
        raise FormatError("is a result of a workspace", path, "name the workspace")


def _is_plane(path: Path) -> bool:
    """Return whether the first unit of a FITS file has two axes: an image, no cube of layers."""
    cards = read_bytes(path, most=_FITS_BLOCK).decode("ascii", errors="replace")
    axes = re.search(r"NAXIS   =\s*(\d+)", cards)
    return axes is not None and axes[1] == "2"


def _has_faces(path: Path) -> bool:
    """Return whether a PLY file is a mesh (or a cloud of points)."""
    faces = parse_header(read_bytes(path, most=_HEAD), path).element("face")
    return faces is not None and faces.count > 0


def first_word(path: Path) -> tuple[str, bytes]:
    """Return the first word of a file, and its first bytes."""
    head = read_bytes(path, most=_HEAD)
    words = head[:80].decode("ascii", errors="replace").split()
    return (words[0] if words else ""), head


def _is_kernel(path: Path) -> bool:
    """Return whether a file is a SPICE kernel.

    Its first word says what it is; older text kernels lack it, and are known by their data blocks.
    """
    word, head = first_word(path)
    return word == "DAFETF" or word.startswith(("DAF/", "KPL/")) or b"\\begindata" in head
