"""Overview, lists, body, results, tables and history of a workspace."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from fusion.inspection import describe_workspace
from fusion.pipeline import Pipeline
from fusion.service.views import ListKind, coverage, list_page, overview, workspace_etag
from fusion.service.views.body import mesh_bytes, shape_layers, shape_mesh, vertex_layer
from fusion.service.views.history import (
    provenance,
    run_list,
    run_record,
    runs_compared,
    solution_tree,
)
from fusion.service.views.outlines import outlines
from fusion.service.views.overview import density_of
from fusion.service.views.results import epsilon_table, residuals
from fusion.service.views.surfaces import SurfaceKind, open_surface
from fusion.service.views.tables import TableFormat, read_table, table_names
from fusion.stages.release import STAGE
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.shapes import write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions

RADIUS = 60.0


def match(number: int, *, used: bool = True) -> dict:
    turn = 0.7 * number
    center = 250.0 * np.array([np.cos(turn), np.sin(turn), 0.3])
    outward = center / np.linalg.norm(center)
    return {
        "name": f"AA{number:04d}", "center_m": center.tolist(), "used": used,
        "residual_m": (0.5 * outward).tolist() if used else [None] * 3,
        "cause": None if used else "coverage", "reason": "" if used else "coverage < 0.3",
        "sigma_m": [0.1, 0.1, 0.1],
    }  # fmt: skip


def test_the_overview_is_that_of_info(workspace) -> None:
    found = overview(workspace)
    assert {key: found[key] for key in describe_workspace(workspace)} == describe_workspace(
        workspace
    )
    assert (found["maplets"], found["fused"], found["bigmaps"], found["scans"]) == (3, 3, 1, 1)
    assert found["results"] == {"registration": None, "scale": None}
    before = workspace_etag(workspace)
    workspace.write_json("scale.json", {"epsilon": 1e-4, "verdict": "accepted"})
    assert overview(workspace)["results"]["scale"]["epsilon"] == 1e-4
    assert workspace_etag(workspace) != before


def test_pages_have_every_item_once(workspace) -> None:
    workspace.maplet_path("AA0001").write_bytes(b"damaged")
    items, after = [], ""
    while True:
        page = list_page(workspace, ListKind.MAPLETS, after=after, limit=2)
        items += page.items
        after = page.next
        if not after:
            break
    assert [each["name"] for each in items] == ["AA0000", "AA0001", "AA0002"]
    assert page.total == 3
    assert "truncated" in items[1]["problem"]
    assert items[2]["longitude_deg"] == pytest.approx(np.degrees(3.0), abs=1e-4)
    scan = list_page(workspace, ListKind.SCANS).items[0]
    assert scan["returns"] == 40_000
    site = list_page(workspace, ListKind.BIGMAPS).items[0]
    assert site["surfaces"] == ["SITE:fused", "SITE:spc"]
    for kind in ListKind:
        list_page(workspace, kind)
    with pytest.raises(InvalidValueError, match="1 … 1000"):
        list_page(workspace, ListKind.SCANS, limit=0)


def test_the_density_of_returns_is_that_of_the_body(workspace) -> None:
    found = coverage(workspace, step_deg=15.0)
    density = found["returns"]["density_per_m2"]
    assert density.shape == (12, 24)
    # Evenly spread over the ball: everywhere the number by the area.
    np.testing.assert_allclose(density, 40_000 / (4 * np.pi * RADIUS**2), rtol=0.15)
    assert found["maplets"]["side_m"] == pytest.approx([12.0] * 3)
    # Half a body without returns, and a tenth of the others counted.
    points = RADIUS * np.array([[1.0, 0.1, 0.2], [-1.0, 0.1, 0.2], [0.1, 0.2, 1.0]])
    some = density_of(points, 30, 6)
    edges = np.sin(np.radians(np.arange(-90, 91, 30)))
    area = np.linalg.norm(points[0]) ** 2 * np.pi / 6 * np.diff(edges)[:, None]
    north = np.linalg.norm(points[2]) ** 2 / np.linalg.norm(points[0]) ** 2
    area = np.where(np.arange(6)[:, None] == 5, area * north, area)
    assert (some * area).sum() == pytest.approx(30.0)
    assert not some[:3].any()
    with pytest.raises(InvalidValueError, match="does not divide"):
        coverage(workspace, step_deg=7.0)


def test_the_body_and_its_layers(workspace) -> None:
    mesh = IcqShape(RADIUS * icq_directions(16)).mesh()
    write_obj_mesh(workspace.root / "SHAPEFILES" / "ball.obj", mesh)
    whole = shape_mesh(workspace)
    few = shape_mesh(workspace, 400)
    assert len(few.facets) <= 400 < len(whole.facets)
    assert few.volume == pytest.approx(whole.volume, rel=0.03)
    content = mesh_bytes(whole)
    length = int.from_bytes(content[:4], "little")
    header = json.loads(content[4 : 4 + length])
    vertices = np.frombuffer(content, "<f4", 3 * header["vertices"], 4 + length).reshape(-1, 3)
    faces = np.frombuffer(content, "<u4", offset=4 + length + vertices.nbytes).reshape(-1, 3)
    np.testing.assert_allclose(vertices + header["center_m"], whole.vertices, atol=1e-5)
    np.testing.assert_array_equal(faces, whole.facets)
    sigma = vertex_layer(workspace, "sigma")
    longitude = np.array([0.0, 0.5, 3.0])
    middles = np.stack([np.cos(longitude), np.sin(longitude), 0 * longitude], axis=1)
    away = RADIUS * np.arccos(np.clip(whole.vertices @ middles.T / RADIUS, -1.0, 1.0))
    for number in range(3):
        np.testing.assert_allclose(sigma[away[:, number] < 5.5], 0.02 * (number + 1), rtol=1e-6)
    assert np.isnan(sigma[(away > 9.0).all(axis=1)]).all()
    difference = vertex_layer(workspace, "difference")
    np.testing.assert_allclose(difference[(away < 4.0).any(axis=1)], 0.2, atol=2e-3)
    there = {each["name"]: (each["of"], each["surfaces"]) for each in shape_layers(workspace)}
    assert there == {"albedo": ("maplet", 3)} | dict.fromkeys(
        ("difference", "sigma", "count", "source"), ("fused", 3)
    )


def test_outlines_are_the_squares_of_the_grids(workspace) -> None:
    found = outlines(workspace, SurfaceKind.FUSED)
    for name, center, axes, side in zip(
        *(found[key] for key in ("name", "center_m", "axes", "side_m")), strict=True
    ):
        grid = open_surface(workspace, SurfaceKind.FUSED, name).grid
        corner = center - side / 2 * (axes[0] + axes[1])
        np.testing.assert_allclose(corner, grid.points(np.zeros(grid.shape))[0, 0], atol=1e-4)
    assert outlines(workspace, SurfaceKind.BIGMAP)["name"] == ["SITE:fused"]
    assert outlines(workspace, SurfaceKind.MAPOLA)["center_m"].shape == (0, 3)
    with pytest.raises(InvalidValueError, match="no outlines of the kind 'pair'"):
        outlines(workspace, SurfaceKind.PAIR)


def test_residuals_point_where_they_do_and_rejected_ones_are_marked(workspace) -> None:
    with pytest.raises(WorkspaceError, match="is not there yet"):
        residuals(workspace)
    content = {"per_mapola": [match(0), match(1, used=False)], "model": "similarity"}
    workspace.write_json("registration.json", content)
    first, second = residuals(workspace)["matches"]
    assert first["residual_up_m"] == pytest.approx(0.5)
    assert (first["residual_east_m"], first["residual_north_m"]) == pytest.approx((0, 0), abs=1e-9)
    assert (second["used"], second["cause"]) == (False, "coverage")
    assert np.isnan(second["size_m"])


@pytest.mark.parametrize(
    ("key", "coordinates"), [("center_m", 2), ("center_m", 6), ("residual_m", 2), ("residual_m", 6)]
)
def test_matches_without_three_coordinates_are_refused(workspace, key, coordinates) -> None:
    # Six of them, so that the numbers would also do for other rows of three.
    rows = [{**match(k % 2), key: [1.0] * coordinates} for k in range(6)]
    workspace.write_json("registration.json", {"per_mapola": rows})
    with pytest.raises(FormatError, match=r"registration\.json: has no usable mapolas"):
        residuals(workspace)


def test_epsilon_by_angle_has_means_with_standard_errors(workspace) -> None:
    rng = np.random.default_rng(1)
    pairs = [
        {
            "image": f"P{k}", "epsilon": value, "epsilon_sigma": 1e-5, "used": k != 3,
            "longitude_deg": 45.0 + 180.0 * (k % 2), "local_time_h": None,
        }
        for k, value in enumerate(rng.normal(1e-4, 1e-5, 40).tolist())
    ]  # fmt: skip
    workspace.write_json("scale.json", {"epsilon": 1e-4, "per_pair": pairs, "per_day": []})
    found = epsilon_table(workspace)
    bins = found["longitude_deg"]["bins"]
    np.testing.assert_allclose(bins["at"], [45.0, 225.0])
    odd = np.array([pairs[k]["epsilon"] for k in range(1, 40, 2) if k != 3])
    assert bins["epsilon"][1] == pytest.approx(odd.mean())
    assert bins["standard_error"][1] == pytest.approx(odd.std(ddof=1) / np.sqrt(19))
    assert len(found["local_time_h"]["single"]["at"]) == 0


def test_tables_are_the_same_in_every_format(workspace) -> None:
    rows = [match(0), match(1, used=False)]
    workspace.write_json("registration.json", {"per_mapola": rows})
    assert table_names(workspace) == ["findings", "registration-mapolas", "scans"]
    table = read_table(workspace, "registration-mapolas")
    assert table.columns["residual_m_x"] == [rows[0]["residual_m"][0], None]
    as_json = json.loads(table.as_bytes(TableFormat.JSON))["columns"]
    assert as_json == table.columns
    with pyarrow.ipc.open_stream(table.as_bytes(TableFormat.ARROW)) as stream:
        assert stream.read_all().to_pydict() == table.columns
    content = table.as_bytes(TableFormat.PARQUET)
    assert pyarrow.parquet.read_table(io.BytesIO(content)).to_pydict() == table.columns
    lines = list(csv.reader(io.StringIO(table.as_bytes(TableFormat.CSV).decode())))
    assert lines[0] == list(table.columns)
    assert float(lines[1][lines[0].index("residual_m_x")]) == rows[0]["residual_m"][0]
    assert lines[2][lines[0].index("residual_m_x")] == ""
    with pytest.raises(WorkspaceError, match="there are: findings"):
        read_table(workspace, "nothing")


def test_a_product_leads_back_to_its_inputs(workspace) -> None:
    settings = workspace.settings()
    Pipeline(workspace, settings, [STAGE]).run_stage("release")
    (run,) = run_list(workspace)
    assert (run["id"], run["stage"]) == ("imported:release", "release")
    graph = provenance(workspace, "release/SITE.MAP")
    nodes = {node["id"]: node for node in graph["nodes"]}
    edges = set(graph["edges"])
    assert ("release/SITE.MAP", "imported:release") in edges
    # By the manifest: its own bigmap, and none of the other maplets.
    sources = {source for made, source in edges if made == "imported:release"}
    assert sources == {"bigmaps/SITE.MAP", "fused/fused.h5"}
    record = run_record(workspace, "imported:release")
    assert nodes["fused/fused.h5"]["digest"] == record["inputs"]["fused/fused.h5"]
    assert not nodes["fused/fused.h5"]["made"]
    with pytest.raises(WorkspaceError, match="made by no stage"):
        provenance(workspace, "fused/fused.h5")
    changed = settings.with_table("release", products=["fits"], version=2)
    Pipeline(workspace, changed, [STAGE]).run_stage("release")
    found = runs_compared(record, run_record(workspace, "imported:release"))
    assert not found["same"]
    assert found["settings"]["ReleaseSettings.version"] == (1, 2)
    assert found["results"]["products"] == (4 * 6 + 1, 4)
    assert not found["inputs"]
    assert runs_compared(record, record)["settings"] == {}
    tree = solution_tree(workspace)
    assert [one["name"] for one in tree["solutions"]] == [tree["in_use"]] == ["imported"]
