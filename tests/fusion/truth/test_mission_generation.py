"""A mission goes on where it was killed, whatever the workers; its folder is nobody else's."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from fusion.runtime import ThreadExecutor
from fusion.runtime.folders import locked
from fusion.truth import (
    PRESETS,
    images,
    make_mission,
    mission,
    mission_size,
    read_truth,
    scans,
    solution,
)
from fusion.truth import size as size_module
from fusion.truth.generation import MAKING_FOLDER
from fusion.truth.presets import MissionSettings
from lidar.formats import read_scan
from lidar.truth import TrackSettings
from spcola.camera import project_image, ray
from spcola.errors import FormatError, WorkspaceError
from spcola.formats.images import read_fits_image, read_image_data
from spcola.formats.solution import read_nominal
from spcola.math import lattice
from spcola.truth.campaign import CampaignSettings

TINY = MissionSettings.tiny()
SMALLEST = replace(
    TINY,
    passes=replace(TINY.passes, count=4),
    lidar=replace(TINY.lidar, spacing=3.0),
    solution=replace(TINY.solution, maplets=8),
    states=replace(TINY.states, per_pass=1),
    campaign=CampaignSettings.of_phases(
        approach=0, preliminary_survey=0, detailed_survey=2, radius=40.0, detector=24
    ),
    tracks=TrackSettings(count=1, duration=300.0),
    images=True,
    shape_q=8,
)


def files_of(root: Path) -> dict[str, str]:
    """Return the digest of every file below `root`, by its path."""
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def times_of(root: Path) -> dict[str, int]:
    """Return when every file below `root` was written, by its path."""
    return {
        path.relative_to(root).as_posix(): path.stat().st_mtime_ns
        for path in root.rglob("*")
        if path.is_file() and MAKING_FOLDER not in path.parts
    }


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("undisturbed")
    make_mission(root, settings=SMALLEST, executor=ThreadExecutor(1))
    return root


def failing(function: Callable[..., Any], after: int) -> Callable[..., Any]:
    """Return `function` as it is interrupted at its call number `after`."""
    calls = 0

    def call(*arguments: Any, **options: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls > after:
            raise KeyboardInterrupt
        return function(*arguments, **options)

    return call


@pytest.mark.parametrize(
    ("module", "writer", "after"),
    [
        (scans, "write_scans", 2),
        (solution, "write_maplet", 5),
        (solution, "write_nominal", 3),
        (solution, "write_landmark", 4),
        (images, "write_image", 5),
        (mission, "write_truth", 0),
    ],
)
def test_an_interrupted_mission_goes_on_to_the_same_bytes(
    module: ModuleType,
    writer: str,
    after: int,
    undisturbed: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(module, writer, failing(getattr(module, writer), after))
        with pytest.raises(KeyboardInterrupt):
            make_mission(tmp_path, settings=SMALLEST, executor=ThreadExecutor(2))
    assert not (tmp_path / "truth.json").exists()
    before = times_of(tmp_path)
    make_mission(tmp_path, settings=SMALLEST, executor=ThreadExecutor(2))
    assert files_of(tmp_path) == files_of(undisturbed)
    made = {k: v for k, v in before.items() if not k.endswith("LIST.TXT") and "MAPFILES" not in k}
    assert made.items() <= times_of(tmp_path).items()


def test_the_number_of_workers_leaves_no_trace(undisturbed: Path, tmp_path: Path) -> None:
    make_mission(tmp_path, settings=SMALLEST, executor=ThreadExecutor(3))
    assert files_of(tmp_path) == files_of(undisturbed)


def test_images_are_rendered_with_true_and_written_with_nominal_states(undisturbed: Path) -> None:
    planted = read_truth(undisturbed)
    names = {path.stem for path in (undisturbed / "images").iterdir()}
    assert (
        names == set(planted.images) == {p.stem for p in (undisturbed / "spc/SUMFILES").iterdir()}
    )
    for name in names:
        image = read_fits_image(undisturbed / "images" / f"{name}.fits")
        pixels = read_image_data(undisturbed / "spc" / "IMAGEFILES" / f"{name}.DAT", 24, 24)
        np.testing.assert_array_equal(image.pixels, pixels)
        nominal = read_nominal(undisturbed / "spc" / "NOMINALS" / f"{name}.NOM")
        np.testing.assert_allclose(image.scobj, nominal.scobj, atol=1e-3)
        truth = planted.similarity.apply(np.array(planted.images[name].position_m))
        assert np.linalg.norm(image.position - truth) > 0.01


def test_the_body_is_where_the_true_state_has_it(undisturbed: Path) -> None:
    planted = read_truth(undisturbed)
    body = planted.body()
    directions = lattice(3000)
    places = body.radius(directions)[:, None] * directions
    normals = body.normals(directions)
    for name, state in planted.images.items():
        known = read_fits_image(undisturbed / "images" / f"{name}.fits")
        sun = planted.similarity.inverse().turn(known.sun)
        truth = replace(
            known, scobj=-np.array(state.position_m), axes=np.array(state.axes), sun=sun
        )
        pixel, line = np.rint(np.stack(project_image(truth, places)) - 1.0)
        facing = np.sum(normals * (truth.position - places), axis=1) > 0
        inside = facing & (np.minimum(pixel, line) >= 0) & (np.maximum(pixel, line) < 24)
        column, row = pixel[inside].astype(int), line[inside].astype(int)
        lit = normals[inside] @ sun > 0.5
        bright = known.pixels > 0.03 * 65535
        assert np.sum(bright[row, column][lit]) >= 0.9 * np.sum(lit)
        rows, columns = np.nonzero(bright)
        beams = ray(truth, columns + 1.0, rows + 1.0)
        nearest = np.linalg.norm(np.cross(truth.position, beams), axis=1)
        assert nearest.max(initial=0.0) < 1.02 * np.linalg.norm(places, axis=1).max()


def test_a_nadir_track_is_written_in_addition_to_the_scans(undisturbed: Path) -> None:
    planted = read_truth(undisturbed)
    assert set(planted.scans) == {"scan01", "scan02", "scan03", "scan04", "track01"}
    scan = read_scan(undisturbed / "lidar" / "track01.dat")
    assert 250 < len(scan.range) <= 300


def test_a_finished_mission_is_kept_and_a_lost_file_is_made_again(
    undisturbed: Path, tmp_path: Path
) -> None:
    root = tmp_path / "mission"
    shutil.copytree(undisturbed, root)
    (root / "lidar" / "scan02.dat").unlink()
    (root / "spc" / "MAPFILES" / "TR0003.MAP").unlink()
    before = times_of(root)
    make_mission(root, settings=SMALLEST)
    assert files_of(root) == files_of(undisturbed)
    after = times_of(root)
    assert {k for k in before if before[k] == after[k]} >= {k for k in before if "lidar" in k}
    make_mission(root, settings=SMALLEST)
    assert times_of(root) == after


def test_another_mission_is_removed_only_if_that_is_wanted(
    undisturbed: Path, tmp_path: Path
) -> None:
    root = tmp_path / "mission"
    shutil.copytree(undisturbed, root)
    other = replace(SMALLEST, seed=2)
    with pytest.raises(WorkspaceError, match="holds another mission"):
        make_mission(root, settings=other)
    assert files_of(root) == files_of(undisturbed)
    make_mission(root, settings=other, replace=True)
    assert json.loads((root / "truth.json").read_text())["settings"]["seed"] == 2


def test_a_mission_of_another_body_is_recognised_with_equal_settings(
    undisturbed: Path, tmp_path: Path
) -> None:
    root = tmp_path / "mission"
    shutil.copytree(undisturbed, root)
    content = json.loads((root / "truth.json").read_text(encoding="utf-8"))
    content["fingerprint"] = "0" * 64
    (root / "truth.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(FormatError, match="of another body"):
        read_truth(root).body()
    with pytest.raises(WorkspaceError, match="holds another mission"):
        make_mission(root, settings=SMALLEST)


def test_parts_of_files_that_a_killed_run_left_are_removed(
    undisturbed: Path, tmp_path: Path
) -> None:
    root = tmp_path / "mission"
    shutil.copytree(undisturbed, root)
    (root / "truth.json").rename(tmp_path / "truth.json")
    with pytest.raises(WorkspaceError, match="other things"):
        make_mission(root, settings=SMALLEST)
    (tmp_path / "truth.json").rename(root / "truth.json")
    (root / "lidar" / ".scan02.dat.abc.part").write_bytes(b"half")
    (root / "lidar" / "scan02.dat").unlink()
    make_mission(root, settings=SMALLEST)
    assert files_of(root) == files_of(undisturbed)


def test_two_programs_do_not_make_one_mission(tmp_path: Path) -> None:
    (tmp_path / MAKING_FOLDER).mkdir()
    with (
        locked(tmp_path / MAKING_FOLDER / "lock"),
        pytest.raises(WorkspaceError, match="another spcola"),
    ):
        make_mission(tmp_path, settings=SMALLEST)


def test_a_disk_without_room_is_reported_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(size_module.shutil, "disk_usage", lambda _: full)
    with pytest.raises(WorkspaceError, match="the disk has 1 kB free"):
        make_mission(tmp_path / "new", settings=SMALLEST)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_every_preset_has_a_size_and_settings_of_its_own(preset: str) -> None:
    settings = PRESETS[preset](3)
    assert settings.seed == settings.body.seed == 3
    assert mission_size(settings).returns > 0
    assert settings.digest != PRESETS[preset](4).digest
