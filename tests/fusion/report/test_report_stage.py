"""The report stage: from a workspace to a page, with what is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fusion.fusing.maplets import write_fused
from fusion.pipeline import Pipeline
from fusion.report import gather_report
from fusion.stages.report import STAGE
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from lidar.formats.mapolas import write_mapolas
from lidar.gridding import Mapola
from spcola.errors import FormatError, WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet


@pytest.fixture
def workspace(tmp_path, places, report_data, monkeypatch):
    # As users do, the folder is named from where one is: paths in it are relative.
    monkeypatch.chdir(tmp_path)
    there = Workspace.create(Path("ws"), Settings().with_table("body", name="Bennu"))
    mapolas = []
    for place in places:
        fused = place.fused
        write_maplet(there.maplet_path(fused.name), Maplet(fused.name, fused.grid, place.spc))
        count = np.isfinite(place.lidar).astype(int)
        mapolas.append(Mapola(fused.name, fused.grid, place.lidar, count=count))
    write_mapolas(there.root / "mapolas", mapolas)
    write_fused(there.root / "fused", [place.fused for place in places])
    identity = {
        **report_data.registration, "scale": 1.0, "rotation_deg": [0.0] * 3,
        "translation_m": [0.0] * 3,
    }  # fmt: skip
    there.write_json("registration.json", identity)
    return there


def test_gathers_what_is_there(workspace, places) -> None:
    workspace.write_json("planted.json", {"planted": [
        {"name": "epsilon", "planted": 1e-4, "recovered": None, "sigma": None, "unit": ""}
    ]})  # fmt: skip
    data = gather_report(workspace, body="Bennu")
    assert data.scale is None
    assert len(data.coverage.centers) == 2
    wanted = {p.fused.name: p for p in places}
    assert {place.fused.name for place in data.surfaces} <= set(wanted)
    for place in data.surfaces:
        inside = np.isfinite(place.lidar) & np.isfinite(wanted[place.fused.name].lidar)
        assert inside.sum() > 1000
        gap = (place.lidar - wanted[place.fused.name].lidar)[inside]
        assert np.abs(gap).max() < 1e-6
    assert np.isnan(data.planted[0].recovered)
    assert data.planted[0].planted == 1e-4
    known = sum(np.count_nonzero(place.fused.valid) for place in places)
    assert len(data.origins.source) == len(data.origins.directions)
    assert len(data.origins.source) == known
    assert data.errors == ()


def test_stage_writes_the_page_and_is_then_up_to_date(workspace) -> None:
    pipeline = Pipeline(workspace, workspace.settings(), [STAGE])
    run = pipeline.run_stage("report")
    page = workspace.report_path.read_text(encoding="utf-8")
    assert "Bennu: lidar and stereophotoclinometry" in page
    assert "There is no scale yet." in page
    assert run.summary["megabytes"] < 5
    assert pipeline.run_stage("report").state == "up to date"
    workspace.write_json("scale.json", {"epsilon": 1e-4, "epsilon_sigma": 1e-5})
    assert pipeline.run_stage("report").state == "ran"
    assert "There is no scale yet." not in workspace.report_path.read_text(encoding="utf-8")


def test_damaged_results_are_named(workspace) -> None:
    workspace.write_json("planted.json", {"planted": [{"name": "epsilon"}]})
    with pytest.raises(FormatError, match=r"planted\.json: does not state what was planted"):
        gather_report(workspace, body="B")
    (workspace.root / "planted.json").unlink()
    workspace.scale_path.write_text("{", encoding="utf-8")
    with pytest.raises(WorkspaceError, match=r"scale\.json: is not JSON"):
        gather_report(workspace, body="B")


def test_nothing_to_report(tmp_path) -> None:
    empty = Workspace.create(tmp_path / "ws", Settings())
    with pytest.raises(WorkspaceError, match="nothing to show yet"):
        Pipeline(empty, empty.settings(), [STAGE]).run_stage("report")
