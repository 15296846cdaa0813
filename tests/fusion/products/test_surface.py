"""OBJ and PLY: facets that face outward, and every number of a valid point back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from fusion.products.formats import read_surface, write_obj, write_ply
from fusion.products.formats.surface import triangles
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.shapes import read_obj_mesh
from spcola.grids import Maplet, MapletGrid

WRITERS = {"obj": write_obj, "ply": write_ply}


@pytest.fixture(params=["obj", "ply"])
def written(request, tmp_path, fused, provenance):
    path = tmp_path / f"dtm.{request.param}"
    WRITERS[request.param](path, fused, provenance)
    return path


def test_reads_back_to_the_last_bit(written, fused, assert_same) -> None:
    assert_same(read_surface(written), fused, everywhere=False)


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_plain_maplet(kind, tmp_path, fused, provenance, assert_same) -> None:
    plain = Maplet("SPC001", fused.grid, fused.height)
    WRITERS[kind](tmp_path / "plain", plain, provenance)
    assert_same(read_surface(tmp_path / "plain"), plain)


def test_same_input_gives_same_bytes(written, tmp_path, fused, provenance) -> None:
    again = tmp_path / "again"
    WRITERS[written.suffix[1:]](again, fused, provenance)
    assert again.read_bytes() == written.read_bytes()


def test_triangles_face_along_uz_and_tile_the_plane(fused) -> None:
    grid = fused.grid
    flat = Maplet("FLAT", grid, np.zeros(grid.shape))
    corners = flat.points().reshape(-1, 3)[triangles(flat)]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    np.testing.assert_allclose(areas @ grid.uz, grid.gsd**2 / 2, rtol=1e-9)
    assert len(areas) == 2 * (grid.size - 1) ** 2


def test_a_missing_point_takes_its_facets_along() -> None:
    grid = MapletGrid([0, 0, 9.0], np.eye(3), 1.0, 2)
    height = np.zeros(grid.shape)
    height[2, 2] = np.nan
    facets = triangles(Maplet("HOLE", grid, height))
    # Six triangles meet at an inner point: two cells lose one each, two lose both.
    assert len(facets) == 32 - 6
    assert facets.max() == 23


def test_other_readers_see_the_surface(tmp_path, fused, provenance) -> None:
    write_obj(tmp_path / "s.obj", fused, provenance)
    mesh = read_obj_mesh(tmp_path / "s.obj")
    np.testing.assert_allclose(mesh.vertices, fused.points()[fused.valid], atol=1e-9)
    np.testing.assert_array_equal(mesh.facets, triangles(fused))


def test_open3d_reads_the_ply(tmp_path, fused, provenance) -> None:
    open3d = pytest.importorskip("open3d")
    write_ply(tmp_path / "s.ply", fused, provenance)
    mesh = open3d.t.io.read_triangle_mesh(str(tmp_path / "s.ply"))
    # Open3D keeps single precision.
    positions = mesh.vertex.positions.numpy()
    np.testing.assert_allclose(positions, fused.points()[fused.valid], atol=1e-5)
    np.testing.assert_array_equal(mesh.triangle.indices.numpy(), triangles(fused))


def test_ply_header(tmp_path, fused, provenance) -> None:
    write_ply(tmp_path / "s.ply", fused, provenance)
    header = (tmp_path / "s.ply").read_bytes().split(b"end_header\n")[0].decode()
    for line in ("property double sigma", "property uchar source", "property int count"):
        assert line in header.splitlines()
    kept = next(x for x in header.splitlines() if x.startswith("comment spcola provenance "))
    assert json.loads(kept.split(" ", 3)[3]) == json.loads(provenance.text())


def test_nothing_to_write(tmp_path, fused, provenance) -> None:
    empty = Maplet("EMPTY", fused.grid, np.full(fused.grid.shape, np.nan))
    with pytest.raises(InvalidValueError, match="no height"):
        write_ply(tmp_path / "s.ply", empty, provenance)


def test_cut_off_anywhere(written) -> None:
    whole = written.read_bytes()
    for length in (0, 3, 200, len(whole) // 2):
        written.write_bytes(whole[:length])
        with pytest.raises(FormatError, match="dtm"):
            read_surface(written)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"spcola frame", b"another note", "not written by spcola"),
        (b'"gsd_m":0.35', b'"gsd_m":-0.3', "does not describe a maplet grid"),
        (b'"half_size":24', b'"half_size":10', "outside its grid"),
        (b"element vertex", b"element vertix", "vertices that are not"),
        (b"property double sigma", b"property double sugma", "vertices that are not"),
        (b"end_header", b"and_header", "is no line of a PLY header"),
    ],
)
def test_ply_each_part_corrupted_once(tmp_path, fused, provenance, old, new, message) -> None:
    path = tmp_path / "s.ply"
    write_ply(path, fused, provenance)
    assert old in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(FormatError, match=message):
        read_surface(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("# spcola frame", "# another note", "not written by spcola"),
        ("# #p m", "# q m", "not written by spcola"),
        ("#p -24", "#p x24", "holds no numbers"),
        ("#p -24", "#p 3 -24", "has not 7 numbers"),
        ("#p -24", "# -24", "without a #p line"),
        ("#p -24", "#p -25", "outside its grid"),
        ("#p -24 -23", "#p -24 -22", "two at one grid point"),
    ],
)
def test_obj_each_part_corrupted_once(tmp_path, make_fused, provenance, old, new, message) -> None:
    path = tmp_path / "s.obj"
    write_obj(path, make_fused(seed=5), provenance)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(FormatError, match=message):
        read_surface(path)
