"""Facts of a mission's image, for ``spcola info``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from spcola.formats.images import ImageFile, open_image
from spcola.navigation import utc_from_et


def image_facts(path: Path) -> dict[str, Any]:
    """Return what an image file contains and its label states; pixels are not read.

    Raises
    ------
    FormatError
        If it cannot be read, or its label contradicts itself or the pixels.
    """
    image = open_image(path)
    label, mid = image.label, image.label.mid_exposure()
    return {
        "kind": f"image ({image.format.upper()}, without a .SUM file)",
        "pixels": image.width,
        "lines": image.height,
        "bits": image.bits,
        "pixel_file": image.pixel_path.name,
        "label_file": None if image.label_path is None else image.label_path.name,
        "name": image.name,
        "target": label.target,
        "instrument": label.instrument,
        "filter": label.filter,
        "mid_utc": None if mid is None else utc_from_et(mid.et, 3),
        "mid_from": None if mid is None else str(mid.source),
        "start_utc": label.start_utc,
        "exposure_s": label.exposure_s,
        "line_exposure_s": label.line_exposure_s,
        "clock_start": label.clock_start,
        "temperatures_k": dict(label.temperatures_k),
        **_shown(image),
        "notes": list(image.notes),
    }


def _shown(image: ImageFile) -> dict[str, Any]:
    """Return how the label wants the image shown."""
    orientation = image.label.orientation
    if orientation is None:
        return {"first_pixel_shown": None, "stored_mirrored": None}
    return {
        "first_pixel_shown": orientation.first_corner,
        "stored_mirrored": orientation.mirrored,
    }
