"""How far surfaces of a synthetic mission are from the true one: a few numbers for each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from fusion.report.planted import SurfaceErrors
from fusion.truth.planted import Planted
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid
from spcola.truth.solution import heights_in_frame


def surface_errors(
    planted: Planted, places: Iterable[tuple[MapletGrid, Mapping[str, FloatArray]]]
) -> list[SurfaceErrors]:
    """Compare surfaces with the truth, all on the same grids.

    The truth is brought to the frame of the solution by the planted similarity, so that planted
    scale, rotation and translation are no errors of heights.

    Parameters
    ----------
    planted : Planted
    places : iterable of (MapletGrid, mapping of str to (2q+1, 2q+1) ndarray)
        Grids in the frame of the solution, and the heights of each surface there by its name,
        metres; NaN where unknown.
    """
    body = planted.body()
    errors: dict[str, list[FloatArray]] = {}
    for grid, heights in places:
        truth = heights_in_frame(body, grid, planted.similarity)
        for name, height in heights.items():
            errors.setdefault(name, []).append((height - truth).ravel())
    return [_of(name, np.concatenate(parts)) for name, parts in errors.items()]


def _of(name: str, errors: FloatArray) -> SurfaceErrors:
    sizes = np.abs(errors[np.isfinite(errors)])
    if not sizes.size:
        return SurfaceErrors(name, 0.0, *[float("nan")] * 3)
    most, nearly_all = np.percentile(sizes, (68.0, 95.0))
    rms = float(np.sqrt(np.mean(sizes**2)))
    return SurfaceErrors(name, sizes.size / errors.size, float(most), float(nearly_all), rms)
