"""Strips of an image, its rendering and the residual, as small pictures."""

from __future__ import annotations

import base64
import io
from functools import cache

import numpy as np

from fusion.report.layout import Colour
from spcola.arrays import AnyArray, FloatArray
from spcola.photometry.photoclinometry import Comparison

# Codes of a palette: unknown; greys from 1 on; residuals from 128 on; between the tiles.
_GREY, _RESIDUAL, _STEPS, _BETWEEN = 1, 128, 127, 255
# Pixels between tiles.
_GAP = 2
# Percentiles of the brightness of an image that are black and white.
_ENDS = (0.5, 99.5)


def strip_codes(comparison: Comparison | None, limit: float, size: int) -> AnyArray:
    """Return image, rendering and residual side by side, as codes of a palette.

    Parameters
    ----------
    comparison : Comparison, optional
        Without it all is unknown.
    limit : float
        Relative residual of the last colour, on both sides of 0.
    size : int
        Points on a side of the grid.

    Returns
    -------
    (size, 3 size + 4) ndarray of uint8
        As an image: right along Uy, up along −Ux. Image and rendering have the same greys.
    """
    tiles = [np.zeros((size, size), dtype=np.uint8)] * 3
    if comparison is not None:
        ends = _ends(comparison.observed)
        tiles = [
            _codes(comparison.observed, ends, _GREY),
            _codes(comparison.expected, ends, _GREY),
            _codes(comparison.residual, (-limit, limit), _RESIDUAL),
        ]
    gap = np.full((size, _GAP), _BETWEEN, dtype=np.uint8)
    return np.hstack([tiles[0], gap, tiles[1], gap, tiles[2]])


def strip_png(codes: AnyArray) -> bytes:
    """Return :func:`strip_codes` as a PNG; equal ones give equal bytes."""
    from PIL import Image  # noqa: PLC0415

    picture = Image.fromarray(np.ascontiguousarray(codes), "P")
    picture.putpalette(_palette())
    stream = io.BytesIO()
    picture.save(stream, "png", optimize=True)
    return stream.getvalue()


def strip_uri(codes: AnyArray) -> str:
    """Return :func:`strip_codes` as a data URI."""
    return f"data:image/png;base64,{base64.b64encode(strip_png(codes)).decode('ascii')}"


def _ends(brightness: FloatArray) -> tuple[float, float]:
    """Return the brightness that is black, and that which is white."""
    known = brightness[np.isfinite(brightness)]
    low, high = np.percentile(known, _ENDS) if known.size else (0.0, 1.0)
    return float(low), max(float(high), float(low) + 1e-9)


def _codes(layer: FloatArray, limits: tuple[float, float], first: int) -> AnyArray:
    """Return the codes of a layer of a maplet as an image; 0 where unknown."""
    image, (low, high) = layer.T, limits
    known = np.isfinite(image)
    share = np.clip((np.where(known, image, low) - low) / (high - low), 0.0, 1.0)
    codes = first + np.rint(share * (_STEPS - 1))
    return np.where(known, codes, 0).astype(np.uint8)


@cache
def _palette() -> bytes:
    """Return 256 colours, three bytes each."""
    import matplotlib as mpl  # noqa: PLC0415
    from matplotlib.colors import to_rgb  # noqa: PLC0415

    steps = np.linspace(0.0, 1.0, _STEPS)
    colours = np.vstack(
        [
            to_rgb(Colour.MISSING),
            mpl.colormaps["gray"](steps)[:, :3],
            mpl.colormaps["RdBu_r"](steps)[:, :3],
            (1.0, 1.0, 1.0),
        ]
    )
    return np.rint(255.0 * colours).astype(np.uint8).tobytes()
