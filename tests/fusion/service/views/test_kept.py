"""Views that took long to make are found again, and never when their files have changed."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from ball import RADIUS

from fusion.service.page import STATIC
from fusion.service.upkeep.preparing import prepare
from fusion.service.views.body import PAGE_FACETS, shape_etag, vertex_layer
from fusion.service.views.outlines import outlines
from fusion.service.views.surfaces import LayerCache, SurfaceKind
from fusion.service.views.surfaces.kept import KeptArrays
from fusion.workspace import Workspace
from spcola.formats.shapes import write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions


@pytest.fixture
def shaped(workspace: Workspace) -> Workspace:
    mesh = IcqShape(RADIUS * icq_directions(16)).mesh()
    write_obj_mesh(workspace.root / "SHAPEFILES" / "ball.obj", mesh)
    return workspace


def test_what_is_prepared_is_not_made_again(
    shaped: Workspace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = vertex_layer(shaped, "sigma", PAGE_FACETS)
    (tmp_path / ".service").mkdir()
    prepare(tmp_path, ["ball", "nowhere"])
    kept = LayerCache(folder=tmp_path / ".service" / "cache")
    with monkeypatch.context() as patch:
        patch.setattr(KeptArrays, "keep", lambda *_: pytest.fail("made again"))
        found = vertex_layer(shaped, "sigma", PAGE_FACETS, cache=kept)
        squares = outlines(shaped, SurfaceKind.FUSED, cache=kept)
    np.testing.assert_array_equal(found, plain)
    for name, values in outlines(shaped, SurfaceKind.FUSED).items():
        np.testing.assert_array_equal(squares[name], values)


def test_a_changed_file_is_another_layer(shaped: Workspace, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    before, tag = _sigma(shaped, folder), shape_etag(shaped, layer="sigma")
    assert tag == shape_etag(shaped, layer="sigma") != shape_etag(shaped)
    for path in (shaped.root / "fused").iterdir():
        path.unlink()
    # Without fused maplets those of the maplets are shown.
    assert shape_etag(shaped, layer="sigma") != tag
    assert not np.array_equal(_sigma(shaped, folder), before, equal_nan=True)


def test_a_damaged_file_is_made_again_and_the_oldest_go(tmp_path: Path) -> None:
    kept, values = KeptArrays(tmp_path, 3000), np.arange(100.0)
    for number in range(4):
        kept.keep(number, {"values": values + number})
        os.utime(
            max(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime_ns), (number, number)
        )
    assert [kept.find(number) is not None for number in range(4)] == [False, False, True, True]
    found = kept.find(3)
    assert found is not None
    np.testing.assert_array_equal(found["values"], values + 3)
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:200])
    assert kept.find(3) is None
    # A folder that cannot be written costs the time alone.
    KeptArrays(tmp_path / "missing" / "folder").keep(0, {"values": values})


def test_the_page_asks_for_the_mesh_that_is_prepared() -> None:
    source = (STATIC.parent / "src/views/ahead.ts").read_text(encoding="utf-8")
    (number,) = re.findall(r"MOST_FACETS = ([\d_]+);", source)
    assert int(number) == PAGE_FACETS


def _sigma(workspace: Workspace, folder: Path) -> np.ndarray:
    return vertex_layer(workspace, "sigma", cache=LayerCache(folder=folder))
