"""Images of a solved maplet and what it lets expect, from the files of its solution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fusion.report.photoclinometry.goodness import residual_limit
from fusion.report.photoclinometry.strips import strip_codes
from fusion.workspace import Workspace
from spcola.arrays import AnyArray
from spcola.grids import Maplet
from spcola.photometry.functions import photometric_function
from spcola.photometry.image_blur import ImageBlurs
from spcola.photometry.photoclinometry import Comparison, PhotoclinometryOptions
from spcola.photometry.secondary_light import image_in_shade, name_of_image, secondary_light
from spcola.shape import RayCaster


def image_strip(
    workspace: Workspace,
    content: Mapping[str, Any],
    maplet: Maplet,
    image: str,
    beyond: RayCaster | None,
    around: RayCaster | None = None,
) -> AnyArray:
    """Return an image on the grid of a maplet, its rendering and the residual, side by side.

    Without pixels all is unknown.

    Parameters
    ----------
    workspace : Workspace
        In the solution.
    content : mapping
        Of its ``photoclinometry.json``.
    maplet : Maplet
        Of that solution.
    image : str
        Name of one that was used for it, as its fit has it.
    beyond : RayCaster, optional
        The shape.
    around : RayCaster, optional
        The maplets around.

    Returns
    -------
    (size, 3 size + 4) ndarray of uint8
        Codes for :func:`strip_png`.

    Raises
    ------
    SpcolaError
        If a file cannot be read.
    """
    one = content["maplets"][maplet.name]
    found, shaded = None, name_of_image(image)
    if workspace.exposure_path(shaded or image).is_file():
        options = content["options"]
        function = photometric_function(options["photometry"])
        fit = one["images"][image]
        exposed, light = workspace.exposed(workspace.image(shaded or image)), None
        if shaded is not None and beyond is not None:
            light = secondary_light(maplet, exposed, beyond, function)
            exposed = image_in_shade(exposed)
        if shaded is None or light is not None:
            found = Comparison.on_grid(
                maplet,
                exposed,
                shift_px=_pair(fit["shift_px"]),
                gradient=_pair(fit.get("gradient")),
                beyond=[caster for caster in (beyond, around) if caster is not None],
                light=light,
                options=PhotoclinometryOptions(function, options["psf_px"], _blurs_of(options)),
            )
    return strip_codes(found, residual_limit(one), maplet.grid.size)


def _blurs_of(options: Mapping[str, Any]) -> ImageBlurs:
    """Return the blur of images that a solution states; those of older ones state none."""
    return ImageBlurs.of_json(options.get("image_blur", ()))


def _pair(values: Any) -> tuple[float, float]:
    """Return two numbers; zeros where they are not known."""
    first, second = values or (None, None)
    return float(first or 0.0), float(second or 0.0)
