"""Table (CSV with a header) of the blur of images: point spread, and smear by motion."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from spcola.errors import FormatError, SettingsError
from spcola.formats.states.columns import Row, image_rows
from spcola.photometry.image_blur import ImageBlur, ImageBlurs

__all__ = ["read_image_blurs"]

_PSF, _SMEAR = "psf_px", ("smear_sample_px", "smear_line_px")


def read_image_blurs(path: str | Path, images: Collection[str]) -> ImageBlurs:
    """Read the blur of images: columns ``image,psf_px,smear_sample_px,smear_line_px``.

    The first has names of images, or patterns such as ``N*``, in which ``*`` stands for any
    letters. A name counts more than a pattern.

    Parameters
    ----------
    path : str or Path
    images : collection of str
        Names of the images that there are.

    Raises
    ------
    FormatError
        If the file cannot be read or a line has no number where there should be one, a blur is out
        of range, a row names none of the images, or two patterns name one.
    """
    rows = image_rows(path, {})
    blurs = ImageBlurs(tuple((name, _blur(row)) for name, row in rows.items()))
    for k, (name, row) in enumerate(rows.items()):
        if not any(blurs.matches(k, image) for image in images):
            raise FormatError(
                f"{name} names no image", f"{row.place}, column image",
                "correct it (* stands for any letters), or leave the row out",
            )  # fmt: skip
    places = [row.place for row in rows.values()]
    for image in images:
        found = blurs.naming(image)
        if len(found) > 1:
            one, other = found[:2]
            raise FormatError(
                f"{blurs.rows[other][0]} names {image}, as {blurs.rows[one][0]} does in "
                f"{places[one].rpartition(', ')[2]}",
                f"{places[other]}, column image",
                f"add a row for {image}, or change one of the patterns",
            )
    return blurs


def _blur(row: Row) -> ImageBlur:
    """Return the blur that a row states."""
    found = row.numbers((_PSF, *_SMEAR))
    if found is None:
        raise FormatError(
            f"has no column {_PSF}", row.place, f"it needs image, {_PSF}, {', '.join(_SMEAR)}"
        )
    psf, sample, line = (float(one) for one in found)
    try:
        return ImageBlur(psf, (sample, line))
    except SettingsError as error:
        column = _PSF if error.where == _PSF else " and ".join(_SMEAR)
        raise FormatError(
            error.what, f"{row.place}, column {column}", "state it in pixels of the image"
        ) from error
