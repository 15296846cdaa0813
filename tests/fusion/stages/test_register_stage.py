"""The stage register through the command line: fits, transforms that are given, refusals."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app, call, called
from registered_ball import GSD, PLANTED, RADIUS, made
from typer.testing import CliRunner

from fusion.workspace import Workspace
from spcola.camera import Camera, ImagePoint, SpcImage, project_image
from spcola.control import Landmark
from spcola.formats.shapes import write_icq
from spcola.formats.solution import write_landmark, write_summary
from spcola.math import Similarity, lattice
from spcola.shape.icq import IcqShape, icq_directions

GIVEN = ("scale", "rotation_deg", "translation_m", "scale_sigma", "covariance")


def refused(*arguments: object) -> str:
    """The line of a command that fails; the content of a refused result is printed too."""
    (line,) = call(*arguments, "--json", code=1).stderr.splitlines()
    return line


def content_of(folder: Path) -> Any:
    return json.loads((folder / "registration.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registered workspace; not to be changed."""
    folder = made(tmp_path_factory.mktemp("fitted") / "WS", lattice(16))
    call("register", folder)
    return folder


@pytest.fixture
def folder(fitted: Path, tmp_path: Path) -> Path:
    shutil.copytree(fitted, tmp_path / "WS")
    return tmp_path / "WS"


def test_the_fit_tests_itself_and_gives_its_inverse(fitted: Path) -> None:
    content = content_of(fitted)
    assert content["scale"] == pytest.approx(PLANTED.scale, abs=4 * content["scale_sigma"])
    assert content["reasons"] == []
    assert content["tests"]["strain"]["p_value"] > 0.01
    assert content["tests"]["scale"]["p_value"] < 0.01
    assert content["stability"]["suspect_regions"] == []
    assert sum(region["n"] for region in content["stability"]["regions"]) == 16
    back = PLANTED.inverse()
    inverse = content["inverse"]
    assert inverse["scale"] == pytest.approx(back.scale, abs=4 * inverse["scale_sigma"])
    off = np.array(inverse["translation_m"]) - back.translation
    assert np.all(np.abs(off) < 4 * np.array(inverse["translation_sigma_m"]))


def test_a_fit_that_is_applied_places_the_mapolas_as_the_fit_did(
    folder: Path, tmp_path: Path
) -> None:
    given = tmp_path / "given.json"
    shutil.copy(folder / "registration.json", given)
    before = {path: path.read_bytes() for path in (folder / "mapolas").iterdir()}
    summary = called("register", folder, "--apply", given)["summary"]
    assert summary["applied"] == {"file": str(given), "inverse": False}
    assert summary["reason"] == "applied, not fitted"
    assert {path: path.read_bytes() for path in (folder / "mapolas").iterdir()} == before
    one, two = json.loads(given.read_text()), content_of(folder)
    for key in GIVEN:
        np.testing.assert_allclose(two[key], one[key], rtol=1e-9)
    assert np.abs([entry["offset_m"] for entry in one["per_scan"]]).max() > 1e-4
    for fit, applied in zip(one["per_mapola"], two["per_mapola"], strict=True):
        np.testing.assert_allclose(applied["scan_shift_m"], fit["scan_shift_m"], atol=1e-12)
        assert applied["position_covariance_m2"] == fit["position_covariance_m2"]
        # Matched where the transform puts it and not where it was: another sampling.
        np.testing.assert_allclose(applied["residual_m"], fit["residual_m"], atol=0.015)
        np.testing.assert_allclose(applied["displacement_m"], fit["displacement_m"], atol=0.015)
    assert two["n_used"] == 16


def test_the_inverse_that_a_registration_states_takes_one_back_to_it(
    folder: Path, tmp_path: Path
) -> None:
    one, given = content_of(folder), tmp_path / "inverse.json"
    given.write_text(json.dumps(one["inverse"]))
    call("register", folder, "--apply", given, "--inverse")
    two = content_of(folder)
    for key in GIVEN:
        np.testing.assert_allclose(two[key], one[key], rtol=1e-6, atol=1e-15)
    given.write_text(json.dumps(two["inverse"]))
    call("register", folder, "--apply", given, "--inverse")
    np.testing.assert_allclose(content_of(folder)["translation_m"], one["translation_m"])


def test_a_transform_alone_reaches_the_fused_maplets(folder: Path, tmp_path: Path) -> None:
    """Far beyond the capture range; kept in the settings, repeated, and up to date."""
    given = {
        "model": "similarity",
        "scale": PLANTED.scale,
        "rotation_deg": np.degrees(PLANTED.rotation_vector).tolist(),
        "translation_m": PLANTED.translation.tolist(),
    }
    (folder / "given.json").write_text(json.dumps(given))
    settings = folder / "spcola.toml"
    text = settings.read_text().replace('apply = ""', 'apply = "given.json"')
    settings.write_text(text.replace("capture_m = 2.0", "capture_m = 0.5"))
    call("register", folder)
    content = content_of(folder)
    assert "no covariance" in " ".join(content["reasons"])
    assert np.all(np.abs(content["residual_mean_m"]) < 0.01)
    assert content["stability"] is None
    assert "up to date" in call("register", folder).output
    call("fuse", folder)
    assert len(list((folder / "fused").glob("*.MAP"))) == 16
    (folder / "given.json").write_text(json.dumps({**given, "scale": 1.0}))
    assert "register: ran" in call("register", folder).output


def test_corrections_of_scans_are_chained(folder: Path, tmp_path: Path) -> None:
    """What the file adds to a scan moves its mapolas by the share that they have of it."""
    one = content_of(folder)
    given = {key: one[key] for key in ("model", "scale", "rotation_deg", "translation_m")}
    entry = {"center_m": [60.0, 0, 0], "offset_m": [0.1, 0, 0], "rotation_deg": [0, 0, 0.1]}
    given["per_scan"] = [{"scan": "one", **entry}, {"scan": "gone", **entry}]
    path = tmp_path / "given.json"
    path.write_text(json.dumps(given))
    call("register", folder, "--apply", path)
    content = content_of(folder)
    for number, mapola in enumerate(content["per_mapola"]):
        arm = np.array(mapola["center_m"]) - [60.0, 0.0, 0.0]
        whole = np.array([0.1, 0, 0]) + np.cross([0, 0, np.radians(0.1)], arm)
        share = 0.75 if number % 2 else 0.0
        np.testing.assert_allclose(mapola["scan_shift_m"], share * whole, atol=1e-12)
    assert "1 of 2 are not in the file" in " ".join(content["reasons"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is not JSON"),
        ("[]", "holds no JSON object"),
        ("{}", "has no usable transform ('translation_m')"),
        ('{"model": "similarity", "translation_m": [0, 0, 0]}', "'rotation_deg'"),
        (
            '{"model": "similarity", "translation_m": [0, 0], "rotation_deg": [0, 0, 0], '
            '"scale": 1}',
            "has no usable transform",
        ),
        (
            '{"model": "similarity", "translation_m": [0, 0, 0], "rotation_deg": [0, 0], '
            '"scale": 1}',
            "has no usable transform",
        ),
        (
            '{"model": "similarity", "translation_m": [0, 0, 0], "rotation_deg": [0, 0, 0], '
            '"scale": -1}',
            "must be positive",
        ),
        (
            '{"model": "similarity", "translation_m": [0, 0, 0], "rotation_deg": [0, 0, 0], '
            '"scale": 1, "per_scan": [{"scan": "one"}]}',
            "has no usable scans",
        ),
        (
            '{"model": "similarity", "translation_m": [0, 0, 0], "rotation_deg": [0, 0, 0], '
            '"scale": 1, "covariance": [[1]]}',
            "has no usable covariance",
        ),
    ],
)
def test_a_file_without_a_transform_is_refused_in_one_line(
    folder: Path, tmp_path: Path, text: str, words: str
) -> None:
    given = tmp_path / "given.json"
    given.write_text(text)
    line = refused("register", folder, "--apply", given)
    assert words in line
    assert "given.json" in line


def test_a_file_that_is_not_there_or_is_the_result_itself_is_refused(folder: Path) -> None:
    line = refused("register", folder, "--apply", folder / "none.json")
    assert "--apply: names" in line
    assert "none.json, which is no file" in line
    assert "spcola.toml" not in line
    own = folder / "registration.json"
    assert "--apply: names" in (line := refused("register", folder, "--apply", own))
    assert "is overwritten" in line
    assert "names no file" in refused("register", folder, "--inverse")


def test_one_cap_is_registered_with_sigmas_that_cover_the_truth(tmp_path: Path) -> None:
    folder = made(tmp_path / "WS", lattice(1500)[:14])
    call("register", folder)
    content = content_of(folder)
    assert content["scale"] == pytest.approx(PLANTED.scale, abs=4 * content["scale_sigma"])
    off = np.array(content["translation_m"]) - PLANTED.translation
    assert np.all(np.abs(off) < 4 * np.array(content["translation_sigma_m"]))
    text = " ".join(content["reasons"])
    assert "equal regions of the body only" in text
    assert "tx_m: weakly determined" in text


def test_a_trial_that_is_refused_keeps_the_registration(tmp_path: Path) -> None:
    folder = made(tmp_path / "WS", lattice(60))
    call("register", folder)
    path = folder / "registration.json"
    before, names = path.read_bytes(), [one["name"] for one in content_of(folder)["per_mapola"]]
    line = refused("register", folder, "--only", names[0], "--model", "rigid")
    assert "the one that was there is kept" in line
    assert path.read_bytes() == before


def test_two_mapolas_are_refused(tmp_path: Path) -> None:
    folder = made(tmp_path / "WS", lattice(16)[:2])
    line = refused("register", folder)
    assert "2 mapola(s) give 6 numbers for 7 parameters" in line
    assert_refused(folder, "not-determined")


def with_landmarks(folder: Path, *, seen: int) -> None:
    """Give the maplets landmarks, and one image that sees the first `seen` of them."""
    workspace = Workspace.open(folder)
    grids = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
    for name, grid in grids.items():
        landmark = Landmark(name, grid, np.full(3, 0.05))
        write_landmark(folder / "LMKFILES" / f"{name}.LMK", landmark)
    camera = Camera(100.0, np.full(2, 512.0), np.array([[60.0, 0, 0], [0, 60.0, 0]]), 1024, 1024)
    center = grids["AA0000"].center
    sight = -center / np.linalg.norm(center)
    across = np.cross(sight, [0.6, 0.8, 0.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(sight, across), sight])
    image = SpcImage("I0", "2019 MAR 01 00:00:00.000", camera, 1e3 * sight, axes, -sight)
    pixels = np.stack(project_image(image, np.array([grid.center for grid in grids.values()])))
    points = [
        ImagePoint(name, *place) for name, place in zip(grids, pixels.T.tolist(), strict=True)
    ]
    write_summary(folder / "SUMFILES" / "I0.SUM", replace(image, landmarks=tuple(points[:seen])))


@pytest.mark.parametrize(
    ("landmarks", "seen"),
    [
        *(("images", seen) for seen in (None, 0, 2, 8)),
        *(("sigmas", seen) for seen in (None, 8)),
        ("ignore", 8),
    ],
)
def test_landmarks_that_no_image_ties_err_by_themselves(
    tmp_path: Path, landmarks: str, seen: int | None
) -> None:
    """No image at all (None), one that sees too few to tie them, or one that ties some."""
    folder = made(tmp_path / "WS", lattice(10))
    with_landmarks(folder, seen=seen or 0)
    if seen is None:
        (folder / "SUMFILES" / "I0.SUM").unlink()
    settings = folder / "spcola.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text(
        text.replace('landmarks = "images"', f'landmarks = "{landmarks}"'), encoding="utf-8"
    )
    call("register", folder)
    content = content_of(folder)
    assert content["scale"] == pytest.approx(PLANTED.scale, abs=4 * content["scale_sigma"])
    if landmarks == "ignore":
        assert content["landmarks"] is None
    else:
        tied = landmarks == "images" and seen == 8
        assert content["landmarks"]["images"] == int(tied)
        assert (content["landmarks"]["patterns"] > 0) == tied


def test_one_maplet_is_refused_for_what_it_is(tmp_path: Path) -> None:
    folder = made(tmp_path / "WS", lattice(16)[:1])
    with_landmarks(folder, seen=1)
    line = refused("register", folder)
    assert "1 mapola(s) give 3 numbers for 7 parameters" in line


def test_a_sphere_without_relief_gives_no_number_or_a_finding(
    tmp_path: Path,
) -> None:
    folder = made(tmp_path / "WS", lattice(16), relief=1e-6)
    refused_or_weak(folder, ("rx_rad", "ry_rad", "rz_rad"))


def test_lidar_of_another_body_gives_no_number(tmp_path: Path) -> None:
    folder = made(tmp_path / "WS", lattice(16), other=500)
    line = refused("register", folder)
    assert "the same body and frame" in line
    assert_refused(folder, "no-match")


def test_a_turn_of_mapolas_against_their_maplets_is_found_whole_and_is_doubtful(
    tmp_path: Path,
) -> None:
    """The rims of the mapolas are turned by half a cell: one match from there finds too little."""
    turn = np.array([0.3, -0.2, 1.4])
    planted = Similarity.from_rotation_vector(np.radians(turn), np.zeros(3), 1.0, "spc", "lidar")
    folder = made(tmp_path / "WS", lattice(16), planted=planted)
    line = refused("register", folder)
    assert "--accept large-rotation" in line
    content = content_of(folder)
    assert content["verdict"] == "doubtful"
    off = np.array(content["rotation_deg"]) - turn
    assert np.all(np.abs(off) < 4 * np.array(content["rotation_sigma_deg"]))
    assert np.all(np.abs(off) < 0.02)
    assert "[large-rotation]" in refused("fuse", folder)
    assert called("fuse", folder, "--accept", "large-rotation")["summary"]["maplets"] == 16


def assert_refused(folder: Path, code: str) -> None:
    """The registration names its reason by a code and offers no number, and nothing uses it."""
    content = content_of(folder)
    assert content["verdict"] == "refused"
    assert code in [found["code"] for found in content["findings"]]
    assert all(content[key] is None for key in GIVEN)
    assert f"[{code}]" in refused("fuse", folder)
    assert f"[{code}]" in refused("fuse", folder, "--accept", code)
    elsewhere = folder.parent / "elsewhere.json"
    shutil.copy(folder / "registration.json", elsewhere)
    line = refused("register", folder, "--apply", elsewhere)
    assert "is from a registration that was refused" in line


def test_a_stage_reports_how_it_closes_the_edges_of_its_shape(tmp_path: Path) -> None:
    folder = made(tmp_path / "WS", lattice(16)[:2])
    vertices = np.ascontiguousarray(RADIUS * icq_directions(4))
    vertices[0, 4, 1] *= 1.003
    write_icq(folder / "SHAPEFILES" / "SHAPE.TXT", IcqShape(vertices))
    note = "1 of 60 pairs of labels that name one vertex differ"
    for options, reported in ((["--against", "shape"], True), ([], False)):
        result = CliRunner().invoke(app, ["register", str(folder), *options])
        assert (note in result.stderr) == reported


@pytest.mark.parametrize("filled", [0.71, 0.5])
def test_mapolas_with_gaps_are_registered(tmp_path: Path, filled: float) -> None:
    folder = made(tmp_path / "WS", lattice(16), filled=filled)
    call("register", folder)
    content = content_of(folder)
    assert content["n_used"] == 16
    assert content["scale"] == pytest.approx(PLANTED.scale, abs=4 * content["scale_sigma"])
    shares = [entry["coverage"] for entry in content["per_mapola"]]
    np.testing.assert_allclose(shares, filled, atol=0.08)


def test_mapolas_too_thin_to_match_are_refused_with_a_suitable_gsd(tmp_path: Path) -> None:
    line = refused("register", made(tmp_path / "WS", lattice(16), filled=0.2))
    # Twenty hundredths are filled by 0.22 returns in a cell, eighty by 1.6.
    wanted = GSD * np.sqrt(np.log(0.2) / np.log(0.8))
    assert f"gsd_m = {wanted:.2g} about 80% would" in line
    assert "one body" not in line


def refused_or_weak(folder: Path, names: tuple[str, ...]) -> None:
    """Register; it is refused, or the named parameters are reported as weak and are covered."""
    result = CliRunner().invoke(app, ["register", str(folder)])
    if result.exit_code == 1:
        assert result.stderr.splitlines()[-1].startswith("error: ")
        return
    content = content_of(folder)
    assert all(any(text.startswith(name) for text in content["reasons"]) for name in names)
    off = np.array(content["rotation_deg"]) - np.degrees(PLANTED.rotation_vector)
    assert np.all(np.abs(off) < 4 * np.array(content["rotation_sigma_deg"]))
