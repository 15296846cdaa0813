"""Labels that GDAL reads: ISIS cubes and PDS3, as nested dictionaries."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from spcola.errors import FormatError, SpcolaError
from spcola.formats.images.warning_filters import warnings_as
from spcola.formats.text import read_bytes, regular_size

__all__ = ["LONGEST_LABEL", "group", "read_gdal_label", "reading_raster"]

LabelFormat = Literal["ISIS3", "PDS"]

_END = re.compile(rb"^[ \t]*END[ \t]*(?:\r|\n|\0|$)", re.IGNORECASE | re.MULTILINE)
LONGEST_LABEL = 1 << 18

# A quoted text that goes on in the next line holds the line ends and the indentation.
_LINE_END = re.compile(r"(?:\\r|\\n|\s)+")


@contextmanager
def reading_raster(path: str | Path, driver: str) -> Iterator[Any]:
    """Yield a dataset of rasterio, opened by one GDAL driver.

    GDAL raises its own errors on damaged files. This is the one place that turns them into one
    line, so the block must contain nothing but reading.

    Parameters
    ----------
    path : str or Path
    driver : str
        GDAL's name of the format.

    Raises
    ------
    FormatError
        If the file cannot be read, or the block fails.
    """
    import rasterio  # noqa: PLC0415  (an eighth of a second at start-up)
    from rasterio.errors import NotGeoreferencedWarning, RasterioError  # noqa: PLC0415

    _check_regular(path)
    try:
        # Images of a camera have no map projection; rasterio warns of each.
        with warnings_as("ignore", NotGeoreferencedWarning):
            opened = rasterio.open(path, driver=driver)
        with opened as dataset:
            yield dataset
    except SpcolaError:
        raise
    except (RasterioError, OSError, ValueError) as error:
        cause = error.__cause__ or error
        raise FormatError(f"cannot be read as {driver} ({cause})", path) from error


def read_gdal_label(path: str | Path, driver: LabelFormat) -> dict[str, Any]:
    """Return the label of an ISIS cube or a PDS3 image.

    Parameters
    ----------
    path : str or Path
        The cube, the image with an attached label, or the detached label.
    driver : {"ISIS3", "PDS"}

    Returns
    -------
    dict
        Groups and objects are dictionaries; a value with a unit is ``{"value": …, "unit": …}``;
        a list of such values remains a list of texts like ``"290.52 <K>"``.

    Raises
    ------
    FormatError
        If GDAL cannot read the label.
    """
    _check_text(path)
    with reading_raster(path, driver) as dataset:
        tags = dataset.tags(ns=f"json:{driver}")
    if not tags:
        raise FormatError("has no label that GDAL can read", path)
    # rasterio cuts the text at its first colon, as if it were a keyword with its value.
    key, rest = next(iter(tags.items()))
    try:
        label = json.loads(f"{key}:{rest}")
    except (json.JSONDecodeError, RecursionError) as error:
        raise FormatError(f"has a label that cannot be read ({error})", path) from error
    if not isinstance(label, dict):
        raise FormatError("has a label without keywords", path)
    return {name: _cleaned(value) for name, value in label.items()}


def group(label: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Return the group of a `label` at `names`, one in the other; an empty one if it is absent."""
    found: Any = label
    for name in names:
        found = found.get(name) if isinstance(found, Mapping) else None
    return dict(found) if isinstance(found, Mapping) else {}


def _check_regular(path: str | Path) -> None:
    """Refuse what is absent, or a pipe: GDAL would wait for it."""
    try:
        regular_size(path)
    except OSError as error:
        raise FormatError(
            f"cannot be read ({error.strerror or error})", path, "check its name and permissions"
        ) from error


def _check_text(path: str | Path) -> None:
    """Refuse a label with bytes that are no text: GDAL's messages would quote them."""
    head = read_bytes(path, most=LONGEST_LABEL)
    end = _END.search(head)
    try:
        head[: end.start() if end else 0].decode()
    except UnicodeDecodeError as error:
        raise FormatError(
            f"has a label with bytes that are no text (UTF-8), the first is byte {error.start + 1}",
            path,
        ) from error


def _cleaned(value: Any) -> Any:
    """Return a value without GDAL's own keys, and texts on one line."""
    if isinstance(value, dict):
        return {k: _cleaned(v) for k, v in value.items() if k not in ("_type", "_container_name")}
    if isinstance(value, list):
        return [_cleaned(item) for item in value]
    return _LINE_END.sub(" ", value) if isinstance(value, str) else value
