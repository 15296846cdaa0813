"""FusedMaplet: what it accepts and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.fusing.maplets import FusedMaplet, Source
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid

GRID = MapletGrid([200.0, 0.0, 0.0], [[0, 0, -1], [0, 1, 0], [1, 0, 0]], 0.5, 2)


def layers() -> dict[str, np.ndarray]:
    height = np.zeros((5, 5))
    height[0, 0] = np.nan
    source = np.full((5, 5), Source.BOTH)
    source[0, 0] = Source.NONE
    return {"height": height, "count": np.arange(25).reshape(5, 5), "source": source}


def test_keeps_its_layers_read_only() -> None:
    fused = FusedMaplet("AA0001", GRID, **layers())
    assert fused.count.dtype == np.int32
    assert fused.source.dtype == np.uint8
    assert fused.share(Source.BOTH) == 24 / 25
    with pytest.raises(ValueError, match="read-only"):
        fused.source[0, 0] = 1


@pytest.mark.parametrize(
    ("layer", "value", "message"),
    [
        ("count", -1, "negative count"),
        ("source", 5, "not 0 … 4"),
        ("source", Source.NONE, "both a height and a source"),
        ("height", np.nan, "both a height and a source"),
    ],
)
def test_refuses_a_bad_point(layer: str, value: float, message: str) -> None:
    good = layers()
    good[layer][2, 3] = value
    with pytest.raises(InvalidValueError, match=message):
        FusedMaplet("AA0001", GRID, **good)


@pytest.mark.parametrize("layer", ["count", "source"])
def test_refuses_a_missing_or_misshapen_layer(layer: str) -> None:
    good = layers()
    with pytest.raises(InvalidValueError, match="needs its count and source"):
        FusedMaplet("AA0001", GRID, **{**good, layer: None})
    with pytest.raises(InvalidValueError, match=r"is needed"):
        FusedMaplet("AA0001", GRID, **{**good, layer: good[layer][:4]})
