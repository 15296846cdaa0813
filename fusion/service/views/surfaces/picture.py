"""Windows of layers as PNG."""

from __future__ import annotations

import io
from functools import cache
from typing import Literal

import numpy as np

from fusion.fusing.maplets import Source
from fusion.report.layout import CODED_COLOURS
from fusion.service.views.surfaces.layers import LAYERS
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError

# Codes of an 8-bit and a 16-bit PNG; 0 is unknown.
_CODES = {8: 255, 16: 65535}


def png_of(
    values: FloatArray, layer: str, limits: tuple[float, float], *, bits: Literal[8, 16] = 8
) -> bytes:
    """Return a window of a layer as PNG.

    With 8 bits in colours, transparent where a value is unknown, and where there is no source.
    With 16 bits in grey: 0 is unknown, and code c > 0 is
    ``low + (c − 1) (high − low) / 65534``. Values beyond the limits have the colour, or the code,
    of the limit.

    Parameters
    ----------
    values : (R, C) ndarray
        NaN where unknown.
    layer : str
        Its colour map is taken.
    limits : (float, float)
        Values of the first and the last colour: `range` of the layer's description.
    bits : {8, 16}

    Raises
    ------
    InvalidValueError
        If there is no such layer, or the limits do not ascend.
    """
    from PIL import Image  # noqa: PLC0415

    if layer not in LAYERS:
        raise InvalidValueError("is no layer", repr(layer), f"there are: {', '.join(LAYERS)}")
    if LAYERS[layer].colours == "source" and bits == 8:
        values = np.where(values == Source.NONE, np.nan, values)
    codes = _codes(values, limits, _CODES[bits])
    stream = io.BytesIO()
    if bits == 16:
        Image.fromarray(codes.astype(np.uint16)).save(stream, "png", compress_level=1)
        return stream.getvalue()
    picture = Image.fromarray(codes.astype(np.uint8), "P")
    picture.putpalette(_palette(LAYERS[layer].colours))
    picture.save(stream, "png", compress_level=1, transparency=0)
    return stream.getvalue()


def colours_of(layer: str) -> list[list[int]]:
    """Return the 255 colours of a layer, red, green and blue, 0 … 255, for a legend."""
    content = _palette(LAYERS[layer].colours)[3:]
    return [list(content[k : k + 3]) for k in range(0, len(content), 3)]


def _codes(values: FloatArray, limits: tuple[float, float], most: int) -> FloatArray:
    """Return 1 … `most` for the values between the limits; 0 where unknown."""
    low, high = limits
    if not (np.isfinite([low, high]).all() and low < high):
        raise InvalidValueError(f"{low} … {high} do not ascend", "range of colours")
    known = np.isfinite(values)
    share = np.clip((np.where(known, values, low) - low) / (high - low), 0.0, 1.0)
    return np.where(known, np.rint(share * (most - 1)) + 1, 0)


@cache
def _palette(colours: str) -> bytes:
    """Return 256 colours, three bytes each; the first one stands for unknown."""
    import matplotlib as mpl  # noqa: PLC0415
    from matplotlib.colors import to_rgb  # noqa: PLC0415

    if colours in CODED_COLOURS:
        # Source 0 … 4 take codes 1, 64.5, … 255: each colour fills its part of the codes.
        known = np.array([to_rgb(colour) for colour in CODED_COLOURS[colours]])
        table = known[np.rint(np.arange(255) / 254 * (len(known) - 1)).astype(int)]
    else:
        table = mpl.colormaps[colours](np.linspace(0.0, 1.0, 255))[:, :3]
    return bytes(3) + np.rint(255.0 * table).astype(np.uint8).tobytes()
