"""Models from files and workspaces, and how they are cut into patches."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.fusing.maplets import FusedMaplet, Source, write_fused
from fusion.products import Provenance
from fusion.products.formats import write_fits_dtm, write_geotiff, write_obj, write_ply
from fusion.truth.assessment import file_model
from fusion.truth.assessment.model import MapletModel, MeshModel, evenly, squares
from spcola.errors import FormatError, WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_icq
from spcola.formats.shapes import write_obj_mesh as write_mesh
from spcola.grids import Maplet, MapletGrid
from spcola.shape.icq import IcqShape, icq_directions


def fused(q: int = 6) -> FusedMaplet:
    grid = MapletGrid.facing([75.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, q)
    height = 0.01 * np.arange(grid.size**2, dtype=float).reshape(grid.shape)
    layer = np.full(grid.shape, int(Source.IMAGE))
    return FusedMaplet("TR0001", grid, height, count=0 * layer, source=layer)


def sphere(q: int = 24, radius: float = 75.0) -> IcqShape:
    return IcqShape(radius * icq_directions(q))


@pytest.mark.parametrize("ending", ["MAP", "fits", "tif", "obj", "ply"])
def test_a_maplet_is_read_from_each_of_our_formats(tmp_path, ending: str) -> None:
    path, maplet, origin = tmp_path / f"X.{ending}", fused(), Provenance("Truth")
    if ending == "MAP":
        write_maplet(path, maplet)
    elif ending == "fits":
        write_fits_dtm(path, maplet, origin, version=1)
    else:
        {"tif": write_geotiff, "obj": write_obj, "ply": write_ply}[ending](path, maplet, origin)
    model = file_model(path, frame="body")
    assert isinstance(model, MapletModel)
    assert model.frame == "body"
    (key,) = model.keys(10)
    tolerance = 2e-4 if ending == "MAP" else 1e-6
    np.testing.assert_allclose(model.patch(key).height, maplet.height, atol=tolerance)


def test_shapes_are_meshes_in_the_given_unit(tmp_path) -> None:
    mesh = sphere().mesh()
    write_icq(tmp_path / "SHAPE.TXT", sphere())
    write_mesh(tmp_path / "a.obj", mesh, unit="m")
    for path in (tmp_path / "SHAPE.TXT", tmp_path / "a.obj"):
        model = file_model(path, unit="m")
        assert isinstance(model, MeshModel)
        assert np.linalg.norm(model.mesh.vertices, axis=1) == pytest.approx(75.0, abs=0.02)


def test_a_release_is_its_fused_maplets(tmp_path) -> None:
    write_fused(tmp_path, [fused()])
    model = file_model(tmp_path)
    assert list(model.keys(5)) == ["TR0001"]
    assert isinstance(model.patch("TR0001"), FusedMaplet)


def test_what_is_no_model_is_refused(tmp_path) -> None:
    with pytest.raises(WorkspaceError, match=r"fused\.h5"):
        file_model(tmp_path)
    (tmp_path / "letter.txt").write_text("Dear reader")
    with pytest.raises(FormatError, match="in no format that is read"):
        file_model(tmp_path / "letter.txt")


def test_a_mesh_is_read_where_it_is() -> None:
    model = MeshModel("ball", sphere(64).mesh())
    keys = model.keys(9)
    assert len(keys) == 9
    for key in keys:
        patch = model.patch(key)
        radius = np.linalg.norm(patch.points()[patch.valid], axis=1)
        assert patch.valid.mean() > 0.95
        assert radius == pytest.approx(75.0, abs=0.03)
        assert patch.grid.gsd == pytest.approx(model.spacing)
    assert model.spacing == pytest.approx(75.0 * np.sqrt(4 * np.pi / (6 * 64**2)), rel=0.01)


def test_large_maps_are_cut_where_they_lie() -> None:
    whole = fused(50)
    maplet = Maplet(whole.name, whole.grid, whole.height)
    parts = squares(maplet, 10, 100)
    assert len(parts) == 16
    for part in parts:
        x, y, _ = whole.grid.project(part.points())
        rows, columns = (np.rint(v + 50).astype(int) for v in (y, x))
        np.testing.assert_array_equal(part.height, whole.height[rows, columns])
    assert len(squares(maplet, 10, 5)) == 5
    assert squares(maplet, 50, 5) == [maplet]


def test_a_choice_is_even() -> None:
    assert evenly(3, 5) == [0, 1, 2]
    assert evenly(101, 3) == [0, 50, 100]
    assert evenly(0, 3) == []
