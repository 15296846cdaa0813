"""Items: values written and read without a loss, and found again by what went into them."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from fusion.estimation.verdict import Code, Finding, Severity
from fusion.pipeline.items import ItemStore, decode, encode
from spcola.grids import Maplet, MapletGrid
from spcola.math import Affine

GRID = MapletGrid.facing(np.array([0.0, 0.0, 250.0]), np.array([0.0, 0.0, 1.0]), 0.5, 4)
MAPLET = Maplet("AA0001", GRID, np.arange(81.0).reshape(9, 9) / 7.0)


def same(one: Any, two: Any) -> bool:
    return (
        encode(one) == encode(two)
        if not encode(one).arrays
        else (encode(one).digest == encode(two).digest)
    )


def test_values_come_back_with_their_types_and_bits() -> None:
    height = MAPLET.height.copy()
    height[0, 0], height[1, 1] = np.nan, -0.0
    value = (
        replace(MAPLET, height=height),
        Affine(np.eye(3), np.arange(3.0), "spc", "lidar"),
        [Finding(Code.NO_MATCH, Severity.NOTE, "none", 0.1 + 0.2, float("inf"))],
        {"a": (1, 2.5, None, True), 3: frozenset({"x", "y"})},
        np.float32(1.5),
        Path("a/b"),
    )
    back = decode(encode(value))
    assert same(back, value)
    assert back[0].height.tobytes() == height.tobytes()
    assert type(back[4]) is np.float32
    assert back[3] == value[3]
    assert back[2] == value[2]


numbers = st.one_of(st.integers(), st.floats(), st.booleans(), st.none(), st.text())
arrays_of = arrays.arrays(
    st.sampled_from([np.float64, np.int16, np.uint8, np.bool_]),
    arrays.array_shapes(min_dims=0, min_side=0, max_side=4),
)
values = st.recursive(
    st.one_of(numbers, arrays_of),
    lambda inner: st.one_of(
        st.lists(inner), st.tuples(inner, inner), st.dictionaries(st.text(), inner)
    ),
    max_leaves=12,
)


@given(values)
def test_any_value_comes_back(value: Any) -> None:
    assert same(decode(encode(value)), value)


@given(values, values)
def test_values_that_differ_have_other_digests(one: Any, two: Any) -> None:
    first, second = encode(one), encode(two)
    alike = first.text == second.text and all(
        a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
        for a, b in zip(first.arrays, second.arrays, strict=True)
    )
    assert (first.digest == second.digest) == alike


def test_what_cannot_be_kept_and_what_is_not_ours_is_refused() -> None:
    for value in (lambda: 1, object(), np.array([object()])):
        with pytest.raises(TypeError, match="cannot be kept"):
            encode(value)
    for text in ('["value","os:system",[]]', '["value","spcola.atomic:flush",[]]'):
        with pytest.raises(ValueError, match="of this program"):
            decode(encode(None)._replace(text=text))


CALLS: list[float] = []


def doubled(maplet: Maplet, factor: float) -> Maplet:
    CALLS.append(factor)
    return replace(maplet, height=factor * maplet.height)


def test_a_result_is_computed_once_and_again_if_its_file_is_damaged(tmp_path: Path) -> None:
    store = ItemStore(tmp_path / "items", "1")
    CALLS.clear()
    first = store.result(doubled, MAPLET, 2.0)
    assert same(store.result(doubled, MAPLET, 2.0), first)
    assert CALLS == [2.0]
    changed = MAPLET.height.copy()
    changed[3, 3] = np.nextafter(changed[3, 3], 1e9)
    store.result(doubled, replace(MAPLET, height=changed), 2.0)
    ItemStore(store.folder, "2").result(doubled, MAPLET, 2.0)
    assert CALLS == [2.0, 2.0, 2.0]
    for path in store.folder.iterdir():
        content = bytearray(path.read_bytes())
        for place in range(40, len(content), 97):
            content[place] ^= 4
        path.write_bytes(content)
    assert same(store.result(doubled, MAPLET, 2.0), first)
    assert len(CALLS) == 4


def test_unused_results_are_removed(tmp_path: Path) -> None:
    store = ItemStore(tmp_path, "1")
    for factor in (1.0, 2.0):
        store.result(doubled, MAPLET, factor)
    for path in tmp_path.iterdir():
        path.touch()
    begun = time.time() + 5.0
    assert len(list(tmp_path.iterdir())) == 2
    store.remove_unused(begun)
    assert not list(tmp_path.iterdir())
