"""Opening of image files: the format is found from the content, a detached label next to it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images.fits_label import FitsImage, read_fits_headers
from spcola.formats.images.image_file import ImageFile, ImageFormat
from spcola.formats.images.image_label import ImageLabel, exposure_notes
from spcola.formats.images.isis_cube import read_isis_cube
from spcola.formats.images.pds3 import DescribedArray, read_pds3
from spcola.formats.images.pds4 import read_pds4
from spcola.formats.images.pixel_sources import DatFile, FitsUnit, RasterBand, chosen_band
from spcola.formats.images.raster_image import read_raster_layout
from spcola.formats.images.special_values import SpecialValues, check_scaling
from spcola.formats.text import read_bytes

__all__ = ["files_of_image", "is_plain", "open_image"]

_DRIVERS = {ImageFormat.TIFF: "GTiff", ImageFormat.PNG: "PNG"}
_STARTS = {
    b"SIMPLE  =": ImageFormat.FITS,
    b"\x89PNG": ImageFormat.PNG,
    **dict.fromkeys((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), ImageFormat.TIFF),
}
_HEAD_BYTES = 4096
_ISIS = re.compile(rb"\s*Object\s*=\s*IsisCube", re.IGNORECASE)
_PDS3 = re.compile(rb"(?:^|\n)\s*(?:PDS|ODL)_VERSION_ID\s*=")
_LABEL_ENDINGS = (".xml", ".lbl")


def open_image(
    path: str | Path, *, band: int | None = None, size: tuple[int, int] | None = None
) -> ImageFile:
    """Open an image file of any format; its pixels are read when they are asked for.

    FITS, PDS3 (attached and detached labels), PDS4, ISIS cubes, TIFF, PNG, and SPC's .DAT. A FITS
    or plain file with a detached label of the same name next to it (.xml, otherwise .lbl) is one
    image with it: the label is read, pixels and byte order are compared with it, and what it does
    not state comes from the FITS header.

    Parameters
    ----------
    path : str or Path
        The image or its detached label.
    band : int, optional
        Band of a file with several ones, from 1.
    size : (2,) of int, optional
        Width and height, for a .DAT file only: it has no header.

    Returns
    -------
    ImageFile

    Raises
    ------
    FormatError
        If the format is unknown, or label and pixels contradict each other.
    InvalidValueError
        If a band does not exist.
    """
    path = Path(path)
    kind = _kind_of(path)
    if kind is None:
        image = _open_plain(path, band, size)
    elif size is not None:
        raise InvalidValueError(f"is {kind} and states its own size", path, "give no size")
    else:
        image = _OPENERS[kind](path, band)
    if image.width * image.height <= 0:
        raise FormatError("has no pixels", path)
    check_scaling(image.scale, image.base, path)
    notes = (*image.notes, *image.label.notes, *exposure_notes(image.label))
    return replace(image, notes=tuple(dict.fromkeys(notes)))


def files_of_image(path: str | Path) -> tuple[Path, ...]:
    """Return the files that an image is made of: its pixels and its label, itself first.

    A file that is no image, or whose other part is missing, is alone.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    OSError
        If it cannot be read.
    """
    path = Path(path)
    try:
        image = open_image(path)
    except (FormatError, InvalidValueError):
        return (path,)
    others = [one for one in (image.pixel_path, image.label_path) if one is not None]
    return (path, *(one for one in dict.fromkeys(others) if not one.samefile(path)))


def is_plain(path: Path) -> bool:
    """Return whether a file has no header: pixels that a label describes, or no image.

    Parameters
    ----------
    path : Path
    """
    return _kind_of(path) is None


def _kind_of(path: Path) -> ImageFormat | None:
    """Return the format of a file from its first bytes; None for plain pixels."""
    head = read_bytes(path, most=_HEAD_BYTES)
    for start, kind in _STARTS.items():
        if head.startswith(start):
            return kind
    if _ISIS.match(head):
        return ImageFormat.ISIS
    if _PDS3.search(head):
        return ImageFormat.PDS3
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    return ImageFormat.PDS4 if text.startswith((b"<?xml", b"<Product")) else None


def _open_fits(path: Path, band: int | None) -> ImageFile:
    """Open a FITS file with the label next to it."""
    fits = read_fits_headers(path, band)
    notes: tuple[str, ...] = ()
    for label_path in _labels_beside(path):
        described = _read_label(label_path, band)
        if described.array.path.samefile(path):
            return _fits_with_label(path, fits, label_path, described)
        notes += (f"{label_path.name} lies next to {path.name}, but names another file",)
    return ImageFile(
        path, ImageFormat.FITS, path, path, fits.width, fits.height, fits.stored,
        _fits_source(path, fits), fits.special, *_fits_scaling(fits), fits.label, None, notes,
    )  # fmt: skip


def _open_pds(path: Path, band: int | None) -> ImageFile:
    """Open a PDS3 or PDS4 label with its pixels."""
    kind = _kind_of(path)
    assert kind is not None
    described = _read_label(path, band)
    array = described.array
    if array.path != path and _kind_of(array.path) is ImageFormat.FITS:
        return _fits_with_label(path, read_fits_headers(array.path, band), path, described)
    return ImageFile(
        path, kind, array.path, path, array.samples, array.lines, array.dtype,
        array, described.special, described.scale, described.base, described.label,
    )  # fmt: skip


def _open_isis(path: Path, band: int | None) -> ImageFile:
    """Open an ISIS cube."""
    cube = read_isis_cube(path)
    chosen = chosen_band(path, band, cube.bands)
    return ImageFile(
        path, ImageFormat.ISIS, cube.pixel_path, path, cube.width, cube.height, cube.dtype,
        RasterBand(path, "ISIS3", chosen), cube.special, cube.scale, cube.base, cube.label,
    )  # fmt: skip


def _open_raster(path: Path, band: int | None) -> ImageFile:
    """Open a TIFF or PNG."""
    kind = _kind_of(path)
    assert kind is not None
    driver = _DRIVERS[kind]
    layout = read_raster_layout(path, driver)
    colors = len(layout.grey) == 3 and band is None
    number = 1 if colors else chosen_band(path, band, len(layout.grey))
    equal = layout.grey[1:] if colors else ()
    alpha = None if layout.alpha is None else RasterBand(path, driver, layout.alpha)
    return ImageFile(
        path, kind, path, None, layout.width, layout.height, layout.dtype,
        RasterBand(path, driver, layout.grey[number - 1], equal), layout.special,
        layout.scale, layout.base, ImageLabel(name=path.name), alpha,
    )  # fmt: skip


def _open_plain(path: Path, band: int | None, size: tuple[int, int] | None) -> ImageFile:
    """Open plain pixels: a .DAT file of known size, or the file of a detached label."""
    if size is not None:
        source = DatFile(path, *size)
        return ImageFile(
            path, ImageFormat.DAT, path, None, *size, source.dtype, source, SpecialValues(),
            1.0, 0.0, ImageLabel(name=path.name),
        )  # fmt: skip
    labels = _labels_beside(path)
    if not labels:
        raise FormatError(
            "is no FITS, PDS3, PDS4, ISIS, TIFF or PNG file",
            path,
            "put its detached label (.lbl or .xml) next to it; a .DAT file needs its size",
        )
    image = _open_pds(labels[0], band)
    if not image.pixel_path.samefile(path):
        raise FormatError(f"is not what the label next to it names ({image.pixel_path.name})", path)
    return replace(image, path=path)


_OPENERS: dict[ImageFormat, Callable[[Path, int | None], ImageFile]] = {
    ImageFormat.FITS: _open_fits,
    ImageFormat.PDS3: _open_pds,
    ImageFormat.PDS4: _open_pds,
    ImageFormat.ISIS: _open_isis,
    ImageFormat.TIFF: _open_raster,
    ImageFormat.PNG: _open_raster,
}
_READERS: dict[ImageFormat | None, Callable[[Path, int | None], DescribedArray]] = {
    ImageFormat.PDS3: read_pds3,
    ImageFormat.PDS4: read_pds4,
}


def _read_label(path: Path, band: int | None) -> DescribedArray:
    """Return the image of a PDS label."""
    return _READERS[_kind_of(path)](path, band)


def _fits_with_label(
    path: Path, fits: FitsImage, label_path: Path, described: DescribedArray
) -> ImageFile:
    """Return a FITS image with its detached label, after comparing both."""
    array = described.array
    _agree("size", (array.samples, array.lines), (fits.width, fits.height), array.path, label_path)
    _agree("pixel type", array.dtype, fits.stored, array.path, label_path)
    _agree("first byte of the pixels", array.offset + 1, fits.offset + 1, array.path, label_path)
    if (described.scale, described.base) != (1.0, 0.0):
        scaling = (described.scale, described.base)
        _agree("scaling", scaling, fits.scaling, array.path, label_path)
    # The label's special values are those in the file, with sign.
    shift = fits.scaling[1] if fits.unsigned else 0.0
    missing, dark, saturated = (
        tuple(value + shift for value in group)
        for group in (
            described.special.missing, described.special.dark, described.special.saturated,
        )
    )  # fmt: skip
    special = SpecialValues(
        missing + fits.special.missing, dark, saturated, highest=fits.special.highest
    )
    label = _filled(described.label, fits.label)
    kind = _kind_of(label_path)
    assert kind is not None
    others = [p.name for p in _labels_beside(array.path) if not p.samefile(label_path)]
    return ImageFile(
        path, kind, array.path, label_path, fits.width, fits.height, fits.stored,
        _fits_source(array.path, fits), special, *_fits_scaling(fits), label, None,
        tuple(f"{name} is not read: {label_path.name} is" for name in others),
    )  # fmt: skip


def _fits_source(path: Path, fits: FitsImage) -> FitsUnit:
    """Return the source of a FITS image's pixels."""
    return FitsUnit(path, fits.unit, fits.plane, fits.unsigned)


def _fits_scaling(fits: FitsImage) -> tuple[float, float]:
    """Return scale and base of what the source returns."""
    return (1.0, 0.0) if fits.unsigned else fits.scaling


def _agree(what: str, label: Any, pixels: Any, path: Path, label_path: Path) -> None:
    """Refuse a file whose header contradicts its detached label."""
    if label != pixels:
        label, pixels = (
            v.str if isinstance(v, np.dtype) else " × ".join(map(str, v)) if isinstance(v, tuple)
            else v
            for v in (label, pixels)
        )  # fmt: skip
        raise FormatError(
            f"has {what} {pixels}, its label {label_path.name} gives {label}",
            path,
            "the label is another image's",
        )


def _filled(label: ImageLabel, other: ImageLabel) -> ImageLabel:
    """Return a label; what it does not state is taken from the other one.

    The middle of the exposure is taken over only with its start: they belong to one clock.
    """
    missing = {
        item.name: getattr(other, item.name)
        for item in fields(label)
        if getattr(label, item.name) in (None, {})
    }
    if label.start_utc is not None:
        missing.pop("mid_utc", None)
    keywords = {**label.keywords, "FITS": other.keywords}
    return replace(label, **missing, keywords=keywords, notes=label.notes + other.notes)


def _labels_beside(path: Path) -> list[Path]:
    """Return the detached labels with the name of a file, .xml before .lbl."""
    # A folder of thousands of images is not searched for each: these spellings are tried.
    found = []
    for ending in _LABEL_ENDINGS:
        names = (path.with_suffix(e) for e in (ending, ending.upper()))
        spellings = [p.with_name(n) for p in names for n in (p.name, p.name.lower())]
        label = next((p for p in spellings if p != path and p.is_file()), None)
        if label is not None and _kind_of(label) in _READERS:
            found.append(label)
    return found
