"""Which images show ground in the shade, where lit ground around it is its only light."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from spcola.camera import SpcImage, project_image
from spcola.errors import SettingsError
from spcola.grids import MapletGrid

__all__ = ["check_shade", "looks_at"]


def looks_at(image: SpcImage, grid: MapletGrid) -> bool:
    """Whether the middle of a grid is in the frame of an image, and faces it.

    Parameters
    ----------
    image : SpcImage
    grid : MapletGrid
    """
    place = np.stack(project_image(image, grid.center[None]))[:, 0]
    inside = bool(((place > 0.5) & (place < np.array(image.size) + 0.5)).all())
    return inside and float((image.position - grid.center) @ grid.uz) > 0.0


def check_shade(asked: Iterable[str], images: Iterable[SpcImage]) -> None:
    """Refuse images that cannot show ground in the shade.

    Parameters
    ----------
    asked : iterable of str
        Their names.
    images : iterable of SpcImage
        Those with pixels and a state of known uncertainty.

    Raises
    ------
    SettingsError
        If one is not among these, or its lower threshold is not raised above its shade.
    """
    known = {image.name: image for image in images}
    for name in asked:
        if name not in known:
            raise SettingsError(
                f"names image {name!r}, which has no pixels of the size of its .SUM, or no state "
                "of known uncertainty",
                "[lithos] secondary_light",
                "check its name, IMAGEFILES and SUMFILES, or leave it out",
            )
        if known[name].thresholds[0] <= 0:
            raise SettingsError(
                f"names image {name!r}, whose lower threshold is 0",
                "[lithos] secondary_light",
                "raise the first of THRSH in its .SUM above the brightness of its shade",
            )
