"""The layers of a product by name, and the maplet made of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from fusion.fusing.maplets import FusedMaplet, Source
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError, InvalidValueError
from spcola.grids import Maplet, MapletGrid

DESCRIPTIONS: Mapping[str, str] = {
    "height": "height along Uz above the maplet plane, m",
    "sigma": "one standard deviation of the height, m",
    "albedo": "relative albedo",
    "count": "lidar returns in the cell",
    "source": "0 none, 1 image, 2 lidar, 3 image and lidar, 4 filled",
}
"""Name of each layer → its description in the products."""

_QUALITY = {
    Source.NONE: 0.0,
    Source.FILLED: 1.0,
    Source.IMAGE: 2.0,
    Source.LIDAR: 2.0,
    Source.BOTH: 3.0,
}


def layers_of(maplet: Maplet) -> dict[str, AnyArray]:
    """Return the layers of `maplet` in the order of :data:`DESCRIPTIONS`.

    A plain maplet has no ``count`` and no ``source``.
    """
    layers: dict[str, AnyArray] = {
        "height": maplet.height,
        "sigma": maplet.sigma,
        "albedo": maplet.albedo,
    }
    if isinstance(maplet, FusedMaplet):
        layers |= {"count": maplet.count, "source": maplet.source}
    return layers


def maplet_of(
    name: str, grid: MapletGrid, layers: Mapping[str, AnyArray], center_sigma: AnyArray
) -> Maplet:
    """Make a maplet of layers: a fused one if they include ``count`` and ``source``."""
    if "count" in layers and "source" in layers:
        return FusedMaplet(name, grid, **layers, center_sigma=center_sigma)
    plain = {key: layers[key] for key in ("height", "sigma", "albedo")}
    return Maplet(name, grid, **plain, center_sigma=center_sigma)


def quality_of(source: AnyArray) -> FloatArray:
    """Return the quality of each point, for readers without `source`.

    0: no height; 1: filled by the integration; 2: images or lidar alone; 3: both.
    """
    table = np.array([_QUALITY[Source(code)] for code in range(len(Source))])
    quality: FloatArray = table[source]
    return quality


def frame_text(maplet: Maplet) -> str:
    """Return name, grid and centre sigma as one line of JSON with all digits (metres)."""
    grid = maplet.grid
    frame = {
        "name": maplet.name,
        "center_m": grid.center.tolist(),
        "axes": grid.axes.tolist(),
        "gsd_m": grid.gsd,
        "half_size": grid.half_size,
        "center_sigma_m": [s if np.isfinite(s) else None for s in maplet.center_sigma.tolist()],
    }
    return json.dumps(frame, separators=(",", ":"))


def parse_frame(text: str, where: str) -> tuple[str, MapletGrid, FloatArray]:
    """Parse the text of :func:`frame_text`: name, grid, centre sigma.

    Raises
    ------
    FormatError
        If it is not such a text; `where` names its place.
    """
    try:
        frame: dict[str, Any] = json.loads(text)
        grid = MapletGrid(
            frame["center_m"], frame["axes"], float(frame["gsd_m"]), int(frame["half_size"])
        )
        sigma = np.array([np.nan if s is None else s for s in frame["center_sigma_m"]], float)
        return str(frame["name"]), grid, sigma
    except (ValueError, TypeError, KeyError, InvalidValueError) as error:
        raise FormatError(f"does not describe a maplet grid ({error})", where) from error
