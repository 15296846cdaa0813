"""The given files, opened: labels, times, digests; pixels are not read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.runtime import Executor
from fusion.stages.images.pixels import file_digest
from spcola.camera.detector import Orientation
from spcola.errors import FormatError, InvalidValueError, SpcolaError
from spcola.formats.images import ImageFile, open_image
from spcola.formats.images.names import NamedImage, is_spc_name, spc_name
from spcola.formats.images.open_image import is_plain
from spcola.formats.states import read_isis_states
from spcola.navigation import utc_from_et


@dataclass(frozen=True, eq=False)
class OpenedImage:
    """A given image file.

    Parameters
    ----------
    path, pixels : Path
        The given file, and that with the pixels.
    digest : str
        SHA-256 of the pixels' file.
    original : str
        Name of the product or file.
    keys : tuple of str
        Names by which tables of states may call it.
    time : float, optional
        Middle of the exposure by the label, ephemeris time, s.
    size : (2,) of int
        Samples and lines.
    scanner : bool
        Whether each line has an exposure of its own.
    filter : str, optional
    label : dict
        Facts of the label for the catalogue.
    notes : tuple of str
    display : Orientation, optional
        How the label wants the pixels shown.
    """

    path: Path
    pixels: Path
    digest: str
    original: str
    keys: tuple[str, ...]
    time: float | None
    size: tuple[int, int]
    scanner: bool
    filter: str | None
    label: dict[str, Any]
    notes: tuple[str, ...]
    display: Orientation | None = None


def open_images(
    paths: Sequence[Path], executor: Executor, *, size: tuple[int, int] | None = None
) -> list[OpenedImage]:
    """Open files in parallel; a file that is given twice, also as its label, is one image.

    Raises
    ------
    FormatError
        If one is no image, or label and pixels contradict each other.
    InvalidValueError
        If two files have the same content.
    """
    # Pixels without a header may be those of a label with another name.
    plain = {path for path in paths if not _has_size(path, size) and is_plain(path)}
    opened = _all_opened([path for path in paths if path not in plain], executor, size)
    named = {one.pixels.resolve() for one in opened.values()}
    alone = [path for path in paths if path in plain and path.resolve() not in named]
    opened |= _all_opened(alone, executor, size)
    images: dict[str, OpenedImage] = {}
    for image in (opened[path] for path in paths if path in opened):
        other = images.setdefault(image.digest, image)
        if other.path.stem == image.path.stem:
            continue
        if not other.pixels.samefile(image.pixels):
            raise InvalidValueError(
                f"holds the same image as {other.path}", image.path, "give one of them"
            )
        if image.path != image.pixels:
            # The label states what its pixels' file may not.
            images[image.digest] = image
    return list(images.values())


def _all_opened(
    paths: Sequence[Path], executor: Executor, size: tuple[int, int] | None
) -> dict[Path, OpenedImage]:
    """Open files in parallel; each by its path."""
    found = executor.stream(lambda path: _opened(path, size), paths)
    return dict(zip(paths, found, strict=True))


def _has_size(path: Path, size: tuple[int, int] | None) -> bool:
    """Return whether the given size is that of a file."""
    return size is not None and path.suffix.upper() == ".DAT"


def _opened(path: Path, size: tuple[int, int] | None) -> OpenedImage:
    """Open one file."""
    image = open_image(path, size=size if _has_size(path, size) else None)
    try:
        mid = image.label.mid_exposure()
    except FormatError as error:
        raise FormatError(f"{error.where}: {error.what}", path, error.do) from error
    original = image.label.name or path.name
    keys = (path.name, path.stem, original, Path(original).stem)
    time = _table_time(image) if mid is None else mid.et
    return OpenedImage(
        path, image.pixel_path, file_digest(image.pixel_path), original,
        tuple(dict.fromkeys(keys)), time, (image.width, image.height),
        image.label.line_exposure_s is not None, image.label.filter, _facts(image), image.notes,
        image.label.orientation,
    )  # fmt: skip


def _table_time(image: ImageFile) -> float | None:
    """Return the middle of the tables of states in an ISIS cube, ephemeris time, s."""
    if image.format != "isis":
        return None
    try:
        return sum(read_isis_states(image.path).span) / 2.0
    except SpcolaError:
        return None


def _facts(image: ImageFile) -> dict[str, Any]:
    """Return what the catalogue keeps of a label."""
    label, mid = image.label, image.label.mid_exposure()
    shown = label.orientation
    return {
        "format": str(image.format),
        "target": label.target,
        "instrument": label.instrument,
        "filter": label.filter,
        "mid_utc": None if mid is None else utc_from_et(mid.et, 3),
        "mid_from": None if mid is None else str(mid.source),
        "exposure_s": label.exposure_s,
        "line_exposure_s": label.line_exposure_s,
        "temperatures_k": dict(label.temperatures_k),
        "first_pixel_shown": None if shown is None else shown.first_corner,
        "stored_mirrored": None if shown is None else shown.mirrored,
    }


def names_of(images: Iterable[OpenedImage], times: dict[str, float], letter: str) -> dict[str, str]:
    """Return the name in SPC of each image, by digest.

    With a letter the names follow SPC's rule. Without, the file's name without its ending is the
    name if it fits; otherwise SPC's rule applies with its first letter or digit.

    Parameters
    ----------
    images : iterable of OpenedImage
    times : dict of str to float
        Middle of the exposure of images by digest, ephemeris time, s.
    letter : str

    Raises
    ------
    InvalidValueError
        If an image has neither a fitting name nor a time, or two images get one name.
    """
    names: dict[str, str] = {}
    taken: dict[str, Path] = {}
    for image in images:
        name = _name(image, times.get(image.digest), letter)
        if name in taken:
            raise InvalidValueError(
                f"{taken[name]} and {image.path} both get the name {name}",
                "names of images",
                "rename one file, or give the ones of another camera another --letter",
            )
        taken[name] = image.path
        names[image.digest] = name
    return names


def _name(image: OpenedImage, time: float | None, letter: str) -> str:
    """Return the name of one image."""
    stem = image.path.stem
    if not letter and is_spc_name(stem):
        return stem
    letter = letter or next(iter(re.findall(r"[A-Za-z0-9]", stem)), "I").upper()
    if time is None:
        raise InvalidValueError(
            f"its name {stem!r} is no name of SPC, and its time is unknown: no name can be made",
            image.path,
            "rename the file (12 characters), or state its time (--times, --poses)",
        )
    return spc_name(letter, NamedImage(str(image.path), time, image.filter))
