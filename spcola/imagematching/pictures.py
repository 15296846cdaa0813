"""Where maplets are to be seen in images: predicted from states, without pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spcola.camera import ImagePoint, SpcImage, project_image
from spcola.grids import MapletGrid
from spcola.imagematching.image_choice import ChoiceOptions, choose_images
from spcola.shape import RayCaster


class Pictures:
    """Finds the images that show the centre of a maplet.

    Parameters
    ----------
    images : sequence of SpcImage
        States; pixels are not needed.
    beyond : RayCaster, optional
        Shape that may hide a maplet.
    options : ChoiceOptions, optional
    """

    def __init__(
        self,
        images: Sequence[SpcImage],
        beyond: RayCaster | None = None,
        options: ChoiceOptions | None = None,
    ) -> None:
        self._images = list(images)
        self._beyond = beyond
        self._options = options or ChoiceOptions()
        self._positions = np.array([image.position for image in images]).reshape(-1, 3)
        self._suns = np.array([image.sun for image in images]).reshape(-1, 3)

    def of(self, grid: MapletGrid) -> tuple[ImagePoint, ...]:
        """Return image, pixel and line of V, with two decimals, in the order of the images.

        At most as many as the options allow, the most informative; none in which the shape
        hides V.

        Parameters
        ----------
        grid : MapletGrid
            Of the maplet, in the frame of the images.
        """
        away = self._positions - grid.center
        limit = np.cos(self._options.most_emission) * np.linalg.norm(away, axis=1)
        facing = (away @ grid.uz >= limit) & (
            self._suns @ grid.uz >= np.cos(self._options.most_incidence)
        )
        able = np.flatnonzero(facing)
        if self._beyond is not None and able.size:
            # From one step above, so that the facet below V hides nothing.
            start = np.broadcast_to(grid.center + grid.gsd * grid.uz, (len(able), 3))
            able = able[~self._beyond.occluded(start, self._positions[able])]
        candidates = [self._images[k] for k in able.tolist()]
        chosen = {image.name for image in choose_images(grid, candidates, options=self._options)}
        found = []
        for image in candidates:
            pixel, line = (float(one) for one in project_image(image, grid.center))
            inside = 0.5 <= pixel < image.camera.width + 0.5
            if image.name in chosen and inside and 0.5 <= line < image.camera.height + 0.5:
                found.append(ImagePoint(image.name, round(pixel, 2), round(line, 2)))
        return tuple(found)
