"""FormU: the formal uncertainty of an SPC solution, from the residuals of its landmarks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from spcola.camera import SpcImage, project_image
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid

# Maplets whose GSD is within this factor of the finest are those of the highest resolution.
_FINEST = 1.01


@dataclass(frozen=True)
class FormalUncertainty:
    """The formal uncertainty of an SPC solution (Weirich et al., section 2.8).

    Attributes
    ----------
    formu : float
        Root mean square of the residuals of the maplets of highest resolution, metres; NaN if none
        of them was measured.
    gsd : float
        Ground sample distance of those maplets, metres.
    maplets, observations : int
        Number of maplets and image measurements used.
    residual_pixels : float
        Root mean square of the same residuals in pixels (both directions together).
    share_80 : float
        80 % of those maplets have a residual below this, metres: the requirement of navigation.
    """

    formu: float
    gsd: float
    maplets: int
    observations: int
    residual_pixels: float
    share_80: float


def formal_uncertainty(
    grids: Mapping[str, MapletGrid], images: Iterable[SpcImage]
) -> FormalUncertainty | None:
    """Return FormU of the landmarks measured in `images`; None without maplets.

    The solved state of an image predicts pixel and line of the centre V of a maplet (eqs. 1–3 of
    Gaskell et al.). The residual is predicted minus measured position, both components
    together, times the size of a pixel at V: the pixel's angle times the distance. A
    maplet's residual is the root mean square over its images; observations that SPC marked with
    ``*`` are left out.

    Parameters
    ----------
    grids : mapping of str to MapletGrid
        Frames of the maplets, by landmark, in the solution's coordinates.
    images : iterable of SpcImage
        With their landmarks.

    Raises
    ------
    InvalidValueError
        If a landmark measured in an image lies behind its camera.
    """
    if not grids:
        return None
    finest = min(grid.gsd for grid in grids.values())
    centers = {k: g.center for k, g in grids.items() if g.gsd <= _FINEST * finest}
    squares: dict[str, list[float]] = {}
    pixels = []
    for image in images:
        seen = [p for p in image.landmarks if p.name in centers and not p.deweighted]
        if not seen:
            continue
        places = np.array([centers[point.name] for point in seen])
        pixel, line = project_image(image, places)
        if np.isnan(pixel).any():
            behind = seen[int(np.argmax(np.isnan(pixel)))].name
            raise InvalidValueError(
                f"has measured {behind}, which lies behind its camera",
                f"image {image.name}",
                "check its .SUM against the maplet",
            )
        off = np.hypot(pixel - [p.pixel for p in seen], line - [p.line for p in seen])
        size = image.camera.pixel_angle * np.linalg.norm(places - image.position, axis=1)
        for point, distance in zip(seen, (off * size).tolist(), strict=True):
            squares.setdefault(point.name, []).append(distance**2)
        pixels.append(off)
    residuals = np.sqrt([np.mean(values) for values in squares.values()])
    count = len(residuals)
    nan = float("nan")
    return FormalUncertainty(
        formu=float(np.sqrt(np.mean(residuals**2))) if count else nan,
        gsd=finest,
        maplets=count,
        observations=sum(map(len, squares.values())),
        residual_pixels=float(np.sqrt(np.mean(np.concatenate(pixels) ** 2))) if count else nan,
        share_80=float(np.quantile(residuals, 0.8)) if count else nan,
    )
