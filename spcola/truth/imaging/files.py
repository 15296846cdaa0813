"""Rendered images as files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from spcola.camera import SpcImage
from spcola.errors import SettingsError
from spcola.formats.images import write_fits_image, write_image_data
from spcola.truth.imaging.rendering import ImageSettings, Rendered

IMAGE_FORMATS = ("dat", "fits")


def write_image(
    folder: str | Path,
    name: str,
    rendered: Rendered,
    image: SpcImage,
    *,
    formats: Sequence[str] = IMAGE_FORMATS,
    settings: ImageSettings | None = None,
) -> tuple[Path, ...]:
    """Write a rendered image; return its files, in the order of the `formats`.

    Parameters
    ----------
    folder : str or Path
        Existing folder.
    name : str
        Name of the files, without suffix.
    rendered : Rendered
        Only the numbers of the detector are written.
    image : SpcImage
        The state for the FITS header: the solved or nominal one, so that the truth is not
        published. A .DAT file has no header.
    formats : sequence of {"dat", "fits"}
    settings : ImageSettings, optional
        Those of the rendering, for the scale of brightness in the FITS header.

    Raises
    ------
    SettingsError
        If a format is unknown.
    WorkspaceError
        If a file cannot be written.
    """
    unknown = set(formats) - set(IMAGE_FORMATS)
    if unknown:
        known = ", ".join(IMAGE_FORMATS)
        raise SettingsError(f"{', '.join(sorted(unknown))} is none of {known}", "image formats")
    paths = []
    for kind in formats:
        path = Path(folder) / f"{name}.{'DAT' if kind == 'dat' else 'fits'}"
        if kind == "dat":
            write_image_data(path, rendered.dn)
        else:
            cards = {}
            if settings is not None:
                cards = {
                    "BITS": (settings.bits, "bits of the detector"),
                    "IOFPERDN": (1.0 / settings.dn_per_iof, "I/F of one number"),
                }
            write_fits_image(path, replace(image, pixels=rendered.dn), cards=cards)
        paths.append(path)
    return tuple(paths)
