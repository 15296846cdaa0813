"""``spcola scale --apply``, through the real command line on a small synthetic mission."""

from __future__ import annotations

import hashlib
import json
import shutil
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from command_line import call

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.stages.scale.rescaling import usable_epsilon
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.camera import Camera
from spcola.camera.linescan import LineScan, LineScanImage
from spcola.errors import NotObservableError
from spcola.formats.solution.line_scan import write_line_scan


def digests(folder):
    """The digest of every file of an SPC solution."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def applied(tmp_path_factory):
    """A mission, its workspace, what the command printed, and the solution's digests before."""
    root = tmp_path_factory.mktemp("apply")
    # A scale ten times that of Bennu's largest day, so that it stands out on a small body.
    call("truth", "make", root / "M", "--preset", "tiny", "--seed", 3, "--set", "epsilon=0.0025")
    call("init", root / "WS", "--spc", root / "M" / "spc", "--body", "Truth")
    call("import", root / "WS", *sorted((root / "M" / "lidar").iterdir()))
    camera = Camera(700.0, [200.5, 1.0], [[0, 142.9, 0], [142.9, 0, 0]], 400, 1)
    scan = LineScan(camera, np.arange(3.0), np.full((3, 3), 500.0), np.tile(np.eye(3), (3, 1, 1)))
    write_line_scan(
        Workspace.open(root / "WS").line_scan_path("L1"),
        LineScanImage("L1", scan, np.array([1.0, 0.0, 0.0])),
    )
    before = digests(root / "M" / "spc")
    printed = call("scale", root / "WS", "--apply", "--as", "C", "--json")
    return root, json.loads(printed.stdout), before


def scaled(root):
    return Workspace.open(root / "WS", "C")


def test_the_command_prints_what_it_wrote(applied):
    root, content, _ = applied
    assert content["applied"]["folder"] == str(scaled(root).home)
    assert content["applied"]["epsilon"] == content["summary"]["epsilon"]
    assert content["applied"]["written"]["MAPFILES"] == 24
    record = read_solution(root / "WS", "C")
    assert record.parent == "imported"
    assert record.made_by == "spcola scale --apply"
    assert record.facts["epsilon"] == content["applied"]["epsilon"]
    scale = hashlib.sha256((root / "WS" / "scale.json").read_bytes()).hexdigest()
    assert record.digests == {"scale.json": scale}
    assert record.settings["ScaleSettings"]["method"] == "pairs"
    assert datetime.fromisoformat(record.made).tzinfo is not None


def test_a_line_scan_is_scaled_and_named_as_not_used(applied):
    root, content, _ = applied
    left = content["summary"]["images_not_used"]
    assert (left["code"], left["images"]) == ("line-scan", ["L1"])
    factor = 1.0 + content["applied"]["epsilon"]
    found = scaled(root).line_scan("L1").scan
    np.testing.assert_allclose(found.positions, 500.0 * factor, rtol=1e-15)
    np.testing.assert_array_equal(found.times, np.arange(3.0))


def test_the_original_is_untouched_and_still_in_use(applied):
    root, _, before = applied
    assert digests(root / "M" / "spc") == before
    assert not list((root / "WS" / "solutions").glob(".*.part"))
    assert Workspace.open(root / "WS").solution == "imported"


def test_unchanged_files_are_shared(applied):
    root, _, _ = applied
    for name in ("MAPLIST.TXT", "PICTLIST.TXT"):
        assert (scaled(root).home / name).samefile(root / "M" / "spc" / name)


def test_every_length_of_the_copy_is_scaled(applied):
    root, content, _ = applied
    factor = 1.0 + content["applied"]["epsilon"]
    old, new = Workspace.open(root / "WS"), scaled(root)
    assert new.maplet_names() == old.maplet_names()
    assert new.image_names() == old.image_names()
    for name in old.maplet_names()[:5]:
        was, now = old.maplet(name), new.maplet(name)
        assert now.grid.gsd == pytest.approx(factor * was.grid.gsd, rel=2e-7)
        np.testing.assert_allclose(now.grid.center, factor * was.grid.center, rtol=3e-7, atol=1e-5)
        np.testing.assert_allclose(now.height, factor * was.height, rtol=3e-7, atol=1e-7)
        np.testing.assert_allclose(now.sigma, factor * was.sigma, rtol=3e-7)
        center = new.landmark(name).grid.center
        np.testing.assert_allclose(center, factor * old.landmark(name).grid.center, rtol=1e-9)
    for was, now in zip(old.images(), new.images(), strict=True):
        np.testing.assert_allclose(now.position, factor * was.position, rtol=1e-9)
        np.testing.assert_allclose(now.axes, was.axes)
    np.testing.assert_allclose(
        new.shape().vertices, factor * old.shape().vertices, rtol=1e-6, atol=1e-6
    )


def test_a_second_run_on_the_copy_finds_no_scale_left(applied):
    root, content, _ = applied
    first = content["summary"]
    assert abs(first["epsilon"]) > 5 * first["epsilon_sigma"]
    again = json.loads(call("scale", root / "WS", "--solution", "C", "--json").stdout)["summary"]
    assert abs(again["epsilon"]) < 2 * again["epsilon_sigma"]
    assert abs(again["n_used"] - first["n_used"]) <= 3


def test_the_difference_is_the_scale_alone(applied, tmp_path):
    root, content, _ = applied
    picture = tmp_path / "diff.png"
    printed = call("solution", "diff", root / "WS", "imported", "C", "-o", picture, "--json")
    found, factor = json.loads(printed.stdout), 1.0 + content["applied"]["epsilon"]
    assert found["maplets"] == 24
    assert found["common_scale"] == pytest.approx(factor, abs=1e-8)
    assert found["shape_radius_ratio"] == pytest.approx(factor, abs=1e-8)
    np.testing.assert_allclose(found["common_rotation_deg"], 0.0, atol=1e-6)
    assert found["centers_left_over_m"]["p100"] < 1e-5 < found["centers_moved_m"]["p50"]
    assert found["pointing_turned_deg"]["p100"] < 1e-6
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_what_exists_is_not_written_over(applied):
    root, _, _ = applied
    result = call("scale", root / "WS", "--apply", "--as", "C", code=1)
    assert "a solution 'C' already" in result.stderr


def test_without_a_usable_epsilon_nothing_is_written(applied, tmp_path):
    root, _, _ = applied
    alone = tmp_path / "WS"
    shutil.copytree(root / "WS", alone, symlinks=True)
    for scan in sorted((alone / "scans").glob("*.h5"))[1:]:
        scan.unlink()
    settings = alone / "spcola.toml"
    settings.write_text(
        settings.read_text().replace("max_emission_deg = 60.0", "max_emission_deg = 0.001")
    )
    accepted = ("--accept", "changed-input")
    result = call("scale", alone, "--apply", "--as", "D", *accepted, code=1)
    assert "the result of scale is refused" in result.stderr
    assert "[scale-not-observed]" in result.stderr
    assert not (alone / "solutions" / "D").exists()


def test_a_name_needs_apply(applied):
    root, _, _ = applied
    assert call("scale", root / "WS", "--as", "D", code=2).stdout == ""


def content_with(*findings, **change):
    """Content of scale.json for an ε of ten sigmas, with some findings."""
    verdict = Verdict(tuple(Finding(*one, "why") for one in findings)).as_json()
    return {"epsilon": 1e-4, "epsilon_sigma": 1e-5, "converged": True, **verdict, **change}


WHERE = Path("scale.json")


@pytest.mark.parametrize(
    "content",
    [
        content_with((Code.SCALE_NOT_OBSERVED, Severity.REFUSED), epsilon=None),
        content_with((Code.SHOTS_FIT_ELSEWHERE, Severity.REFUSED)),
        content_with((Code.MERIDIAN_BEYOND_PRIOR, Severity.DOUBTFUL)),
        content_with((Code.EPSILON_NOT_DETERMINED, Severity.NOTE)),
        content_with((Code.EPSILON_NOT_SEPARABLE, Severity.NOTE)),
        content_with((Code.EPSILON_NOT_SIGNIFICANT, Severity.NOTE)),
        content_with((Code.SCALE_NOT_CONVERGED, Severity.NOTE)),
        {"epsilon": 1e-4, "epsilon_sigma": 1e-5, "converged": True},
    ],
)
def test_an_epsilon_is_usable_only_if_the_data_gave_it(content):
    with pytest.raises(NotObservableError, match="there is no epsilon to apply"):
        usable_epsilon(content, WHERE)


def test_notes_on_other_terms_do_not_forbid_it():
    content = content_with((Code.TERMS_FROM_PRIOR, Severity.NOTE))
    assert usable_epsilon(content, WHERE) == (1e-4, 1e-5)


def test_what_forbids_it_can_be_accepted_by_its_code_but_a_refusal_cannot():
    weak = content_with(
        (Code.EPSILON_NOT_SEPARABLE, Severity.NOTE), (Code.EPSILON_NOT_SIGNIFICANT, Severity.NOTE)
    )
    with pytest.raises(NotObservableError, match="--accept epsilon-not-significant"):
        usable_epsilon(weak, WHERE, ["epsilon-not-separable"])
    both = ["epsilon-not-separable", "epsilon-not-significant"]
    assert usable_epsilon(weak, WHERE, both) == (1e-4, 1e-5)
    refused = content_with((Code.SHOTS_FIT_ELSEWHERE, Severity.REFUSED))
    with pytest.raises(NotObservableError):
        usable_epsilon(refused, WHERE, ["shots-fit-elsewhere"])
