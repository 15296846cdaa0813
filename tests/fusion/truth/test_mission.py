"""A tiny synthetic mission: the same bytes from a seed, and files that agree with each other."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusion.truth import make_mission, read_truth
from fusion.truth.planted import Planted
from fusion.truth.presets import MissionSettings
from fusion.truth.recovery import compare
from lidar.formats import read_scan
from spcola.camera import project_image
from spcola.errors import FormatError, WorkspaceError
from spcola.formats.maplets import read_maplet
from spcola.formats.shapes import read_icq
from spcola.formats.solution import read_landmark, read_list, read_nominal, read_summary
from spcola.navigation import et_from_utc

SMALLEST = replace(
    MissionSettings.tiny(),
    passes=replace(MissionSettings.tiny().passes, count=4),
    lidar=replace(MissionSettings.tiny().lidar, spacing=3.0),
    solution=replace(MissionSettings.tiny().solution, maplets=8),
    day_scale_bias=(1e-4, -1e-4),
)


@pytest.fixture(scope="module")
def mission(tmp_path_factory) -> tuple[Path, Planted]:
    folder = tmp_path_factory.mktemp("mission")
    return folder, make_mission(folder, settings=MissionSettings.tiny())


def _digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def test_a_seed_gives_the_same_bytes_and_another_other_ones(tmp_path) -> None:
    digests = []
    for name, settings in (("a", SMALLEST), ("b", SMALLEST), ("c", replace(SMALLEST, seed=2))):
        make_mission(tmp_path / name, settings=settings)
        digests.append(_digest(tmp_path / name))
    assert digests[0] == digests[1] != digests[2]


def test_the_truth_reads_back(mission, tmp_path) -> None:
    folder, planted = mission
    back = read_truth(folder)
    assert back.settings == planted.settings
    assert dict(back.scans) == dict(planted.scans)
    assert planted.similarity.scale == pytest.approx(1 / 1.00025, abs=1e-15)
    make_mission(tmp_path, settings=SMALLEST)
    assert sorted(read_truth(tmp_path).days.values()) == [-1e-4, 1e-4]
    content = json.loads((folder / "truth.json").read_text())
    assert content["epsilon"] == 2.5e-4
    assert content["prime_meridian_deg"] == 0.012


def test_lists_name_every_file(mission) -> None:
    spc = mission[0] / "spc"
    for name, kind, folder, suffix in (
        ("PICTLIST.TXT", "image", "SUMFILES", ".SUM"),
        ("PICTLIST.TXT", "image", "NOMINALS", ".NOM"),
        ("LMRKLIST.TXT", "landmark", "LMKFILES", ".LMK"),
        ("MAPLIST.TXT", "landmark", "MAPFILES", ".MAP"),
    ):
        listed = read_list(spc / name, kind=kind)
        assert sorted(listed) == sorted(p.stem for p in (spc / folder).glob(f"*{suffix}"))


def test_landmarks_and_images_agree(mission) -> None:
    folder, planted = mission
    spc = folder / "spc"
    images = {p.stem: read_summary(p) for p in (spc / "SUMFILES").glob("*.SUM")}
    landmarks = {p.stem: read_landmark(p) for p in (spc / "LMKFILES").glob("*.LMK")}
    from_images = {(i.name, m.name, m.pixel, m.line) for i in images.values() for m in i.landmarks}
    from_landmarks = {
        (p.name, k.name, p.pixel, p.line) for k in landmarks.values() for p in k.pictures
    }
    assert from_images == from_landmarks
    assert len(from_images) > 2 * len(landmarks)
    solved, true = [], []
    for image, name, pixel, line in from_images:
        at = project_image(images[image], landmarks[name].grid.center)
        solved.append([at[0] - pixel, at[1] - line])
        state = planted.images[image]
        truth = replace(images[image], scobj=-np.array(state.position_m), axes=np.array(state.axes))
        at = project_image(truth, planted.centers[name].true_center)
        true.append([at[0] - pixel, at[1] - line])
    # What is measured is true but for 0.3 pixels; the solution is wrong by its own errors too.
    assert np.std(true) == pytest.approx(0.3, rel=0.1)
    assert 0.3 < np.std(solved) < 1.0


def test_landmarks_and_maplets_have_one_place_and_overlaps_are_projected(mission) -> None:
    spc = mission[0] / "spc"
    maplets = {p.stem: read_maplet(p) for p in (spc / "MAPFILES").glob("*.MAP")}
    for name, maplet in maplets.items():
        landmark = read_landmark(spc / "LMKFILES" / f"{name}.LMK")
        np.testing.assert_allclose(landmark.grid.center, maplet.grid.center, atol=1e-5)
        np.testing.assert_allclose(landmark.sigma, 0.06, atol=1e-9)
        assert np.isfinite(maplet.sigma[maplet.valid]).all()
        assert landmark.overlaps
        for overlap in landmark.overlaps:
            x, y, height = maplet.grid.project(maplets[overlap.name].grid.center)
            expected = (x, y, height / maplet.grid.gsd)
            np.testing.assert_allclose((overlap.x, overlap.y, overlap.h), expected, atol=0.006)


def test_states_are_off_by_their_sigma_and_span_the_scan(mission) -> None:
    folder, planted = mission
    errors = []
    for path in (folder / "spc" / "SUMFILES").glob("*.SUM"):
        image = read_summary(path)
        scan = read_scan(folder / "lidar" / f"scan{path.stem[1:3]}.dat")
        offset = planted.scans[f"scan{path.stem[1:3]}"].offset_m
        nearest = np.argmin(np.abs(scan.time - et_from_utc(image.utc)))
        assert abs(scan.time[nearest] - et_from_utc(image.utc)) < 1.0
        speed = 2 * np.pi / planted.settings.passes.period
        angle = speed * (et_from_utc(image.utc) - scan.time[nearest])
        x, y, z = scan.spacecraft[nearest] - offset
        turned = [x + angle * y, y - angle * x, z]
        errors.append(image.position - planted.similarity.apply(turned))
        nominal = read_nominal(folder / "spc" / "NOMINALS" / f"{path.stem}.NOM")
        assert np.all(np.abs(nominal.scobj + planted.similarity.apply(turned)) < 6.5)
    assert np.std(errors) == pytest.approx(0.20, rel=0.25)


def test_the_shape_is_the_body_in_spc_coordinates(mission) -> None:
    folder, planted = mission
    shape = read_icq(folder / "spc" / "SHAPEFILES" / "SHAPE.TXT")
    assert shape.q == 24
    places = planted.similarity.inverse().apply(shape.vertices.reshape(-1, 3))
    error = np.linalg.norm(places, axis=1) - planted.body().radius(places)
    assert np.abs(np.median(error)) < 0.05


def test_a_folder_of_other_things_is_left_alone(tmp_path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(WorkspaceError, match="other things"):
        make_mission(tmp_path, settings=SMALLEST)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_pulls_are_errors_over_sigmas(mission) -> None:
    planted = mission[1]
    registration = {
        "scale": planted.similarity.scale + 1e-4,
        "scale_sigma": 5e-5,
        "rotation_deg": [0.006, -0.008, 0.013],
        "rotation_sigma_deg": [0.001, 0.001, 0.001],
        "translation_m": [0.07, -0.05, 0.04],
        "translation_sigma_m": [0.01, 0.01, 0.01],
    }
    day = next(iter(planted.days))
    scale = {
        "epsilon": 3.0e-4,
        "epsilon_sigma": 5e-5,
        "size_correction_m": 0.012,
        "size_correction_sigma_m": 0.002,
        "prime_meridian_deg": 0.012,
        "prime_meridian_sigma_deg": 0.001,
        "trajectory": "spc",
        "per_day": [{"day": day, "n": 3, "epsilon": 2e-4, "epsilon_sigma": 5e-5}],
    }
    rows = {row.name: row for row in compare(planted, registration, scale)}
    assert rows["registration scale"].pull == pytest.approx(2.0)
    assert rows["registration rotation z"].pull == pytest.approx(1.0)
    assert rows["registration translation x"].pull == pytest.approx(0.0)
    assert rows["epsilon"].pull == pytest.approx(1.0)
    assert rows["size correction"].planted == pytest.approx(0.010)
    assert rows["prime meridian"].unit == "deg"
    assert rows[f"epsilon of {day}"].pull == pytest.approx(-1.0)
    assert np.isnan(rows["centre offset x"].pull)


def test_a_missing_or_garbled_truth_is_one_line(mission, tmp_path) -> None:
    with pytest.raises(WorkspaceError, match=r"truth\.json"):
        read_truth(tmp_path)
    path = tmp_path / "truth.json"
    good = json.loads((mission[0] / "truth.json").read_text())
    path.write_text("{")
    with pytest.raises(FormatError, match="JSON"):
        read_truth(path)
    for entry in ("settings", "scans", "day_scale_bias"):
        path.write_text(json.dumps({k: v for k, v in good.items() if k != entry}))
        with pytest.raises(FormatError, match=entry):
            read_truth(path)
    good["settings"]["body"]["radius"] = -1
    path.write_text(json.dumps(good))
    with pytest.raises(FormatError, match="radius"):
        read_truth(path)
