"""Registration by images through the real commands, on a small mission with images."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, called, refused
from scipy.spatial.transform import Rotation

from fusion.registration.results.keys import OLD_KEYS, REGISTRATION_KEYS
from fusion.runtime import Progress, ThreadExecutor
from fusion.stages.photometry import PHOTOMETRY_KEYS
from fusion.truth import make_mission
from fusion.truth.presets import MissionSettings
from fusion.workspace import Workspace
from spcola.camera import Camera
from spcola.camera.linescan import LineScan, LineScanImage
from spcola.formats.solution import read_summary, write_summary
from spcola.formats.solution.line_scan import write_line_scan
from spcola.truth.campaign import CampaignSettings


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A workspace with mapolas and images of 128² pixels; tests set how it is registered."""
    folder = tmp_path_factory.mktemp("images")
    tiny = MissionSettings.tiny()
    settings = replace(
        tiny, images=True, image_formats=("dat",),
        campaign=CampaignSettings(radius=tiny.body.radius, detector=128),
    )  # fmt: skip
    mission = folder / "mission"
    make_mission(mission, settings=settings, executor=ThreadExecutor(2), progress=Progress())
    call("init", folder / "WS", "--spc", mission / "spc")
    call("import", folder / "WS", *sorted((mission / "lidar").iterdir()))
    call("mapolas", folder / "WS")
    line = Camera(700.0, [200.5, 1.0], [[0, 142.9, 0], [142.9, 0, 0]], 400, 1)
    scan = LineScan(line, np.arange(2.0), np.full((2, 3), 500.0), np.tile(np.eye(3), (2, 1, 1)))
    write_line_scan(
        Workspace.open(folder / "WS").line_scan_path("L1"),
        LineScanImage("L1", scan, np.array([1.0, 0.0, 0.0])),
    )
    return folder / "WS", settings


def set_keys(workspace, table, **keys):
    path = workspace / "spcola.toml"
    lines = path.read_text().splitlines()
    start = lines.index(f"[{table}]")
    for key, value in keys.items():
        row = next(k for k in range(start, len(lines)) if lines[k].startswith(f"{key} ="))
        lines[row] = f"{key} = {json.dumps(value)}"
    path.write_text("\n".join(lines) + "\n")


def registered(workspace, **keys):
    set_keys(workspace, "register", **keys)
    summary = called("register", workspace)["summary"]
    return summary, content_of(workspace)


def content_of(workspace):
    return json.loads((workspace / "registration.json").read_text())


def wrong_images(workspace, target, alter):
    """A copy whose images are altered: `alter` gets the planes (24, 128, 128), bytes of a pixel."""
    shutil.copytree(workspace, target, symlinks=True)
    paths = sorted((target / "IMAGEFILES").iterdir())
    planes = np.stack([np.fromfile(path, "V2").reshape(128, 128) for path in paths])
    for path, plane in zip(paths, alter(planes), strict=True):
        path.unlink()  # a link into the mission
        path.write_bytes(plane.tobytes())
    return target


def turned_states(workspace, target, angle_deg):
    """A copy whose spacecraft are turned about Z, and with them their cameras and the Sun."""
    shutil.copytree(workspace, target, symlinks=True)
    turn = Rotation.from_euler("z", angle_deg, degrees=True).as_matrix()
    for path in (target / "SUMFILES").glob("*.SUM"):
        image = read_summary(path)
        path.unlink()
        write_summary(path, replace(
            image, scobj=turn @ image.scobj, axes=image.axes @ turn.T, sun=turn @ image.sun,
        ))  # fmt: skip
    return target


def codes(content):
    return {found["code"] for found in content["findings"] if found["severity"] != "note"}


@pytest.fixture(scope="module")
def found(workspace):
    """What each kind makes of the workspace: the summary of the stage and the registration."""
    return {by: registered(workspace[0], by=by) for by in ("topography", "images", "both")}


def names_the_line_scan(summary):
    left = summary["images_not_used"]
    return (left["code"], left["images"]) == ("line-scan", ["L1"])


def test_register_names_the_line_scans_that_it_leaves_out(found):
    assert all(names_the_line_scan(found[by][0]) for by in ("images", "both"))


@pytest.mark.parametrize(
    ("stage", "key", "value"), [("fuse", "light", "images"), ("mapolas", "trajectory", "spc")]
)
def test_stages_name_the_line_scans_that_they_leave_out(workspace, tmp_path, stage, key, value):
    copy = tmp_path / "WS"
    shutil.copytree(workspace[0], copy, symlinks=True)
    registered(copy)
    set_keys(copy, stage, **{key: value})
    some = ("--only", Workspace.open(copy).maplet_names()[0])
    assert names_the_line_scan(called(stage, copy, *some)["summary"])


def test_what_was_planted_is_recovered_by_images(workspace, found):
    _, settings = workspace
    summary, content = found["images"]
    assert content["by"] == summary["by"] == "images"
    assert content["n_images"] == content["n_images_compared"] == 24
    for _, written in found.values():
        assert set(written) - set(OLD_KEYS.values()) <= set(REGISTRATION_KEYS)
        entry = written["per_mapola"][0].keys() - set(OLD_KEYS.values())
        assert {f"per_mapola.{key}" for key in entry} <= set(REGISTRATION_KEYS)
        assert written["agreement"]["median_clearness"] == written["agreement"]["median_z_score"]
    assert content["verdict"] == "accepted"
    truth = settings.to_spc
    turned = np.degrees(truth.rotation_vector) - content["rotation_deg"]
    assert np.all(np.abs(turned) < 4.0 * np.array(content["rotation_sigma_deg"]))
    assert abs(content["scale"] - truth.scale) < 4.0 * content["scale_sigma"]
    assert max(content["rotation_sigma_deg"]) < 0.035
    assert content["maplet_sigma_m"] is None
    for entry in content["per_mapola"]:
        assert entry["n_images"] > 1 or entry["reason"]
        assert all(isinstance(count, int) for count in entry["images_left_out"].values())
        if entry["used"]:
            assert len(entry["surface_residual_m"]) == 3


def test_both_kinds_together_are_as_sharp_as_either(found):
    content = found["both"][1]
    assert content["scale_sigma"] <= found["topography"][1]["scale_sigma"]
    turned = [np.array(found[by][1]["rotation_sigma_deg"]) for by in ("both", "images")]
    assert np.all(turned[0] <= 1.02 * turned[1])
    assert content["n_used"] + content["n_rejected"] == len(content["per_mapola"]) == 24
    chi2 = [e["types_chi2"] for e in content["per_mapola"] if e["types_chi2"] is not None]
    assert len(chi2) > 15
    assert 1.0 < np.mean(chi2) < 6.0
    for entry in content["per_mapola"]:
        kinds = entry["observation_types"]
        assert entry["used"] == (kinds["topography"]["used"] or kinds["images"]["used"])
        if kinds["topography"]["used"] and kinds["images"]["used"]:
            sigmas = np.array([kinds[kind]["sigma_m"] for kind in kinds])
            assert np.all(np.array(entry["sigma_m"]) < sigmas.max(axis=0))
    # The scale by images depends on errors of states that no file contains.
    assert all("scale_per_m" not in entry for entry in content["per_mapola"])
    # A mapola that images hardly place must not make the mission look bad.
    left = np.std([entry["residual_m"] for entry in content["per_mapola"] if entry["used"]], axis=0)
    np.testing.assert_allclose(content["residual_std_m"], left)


def mirrored(planes):
    return planes[:, :, ::-1]


def half_mirrored(planes):
    return [plane if k % 2 else plane[:, ::-1] for k, plane in enumerate(planes)]


def exchanged(planes):
    return np.roll(planes, 7, axis=0)


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("by", "alter", "code"),
    [
        ("both", mirrored, "images-not-matched"),
        slow("images", mirrored, "not-determined"),
        slow("images", half_mirrored, "images-not-matched"),
        slow("both", half_mirrored, "images-not-matched"),
        slow("images", exchanged, "not-determined"),
        slow("both", exchanged, "images-not-matched"),
    ],
)
def test_images_that_do_not_belong_are_not_used_in_silence(workspace, tmp_path, by, alter, code):
    place = wrong_images(workspace[0], tmp_path / "WS", alter)
    line = call("register", place, "--by", by, code=1).output
    content = content_of(place)
    assert codes(content) == {code}
    assert content["verdict"] == ("refused" if code == "not-determined" else "doubtful")
    assert f"[{code}]" in line
    assert f"[{code}]" in call("fuse", place, code=1).output


@pytest.mark.slow
@pytest.mark.parametrize("by", ["images", "both"])
def test_images_of_another_body_are_not_used_in_silence(workspace, tmp_path, by):
    place, settings = workspace
    other = replace(
        MissionSettings.tiny(2), images=True, image_formats=("dat",), campaign=settings.campaign
    )
    make_mission(
        tmp_path / "other", settings=other, executor=ThreadExecutor(2), progress=Progress()
    )
    paths = sorted((tmp_path / "other" / "spc" / "IMAGEFILES").iterdir())
    place = wrong_images(
        place, tmp_path / "WS", lambda _: [np.fromfile(path, "V2") for path in paths]
    )
    call("register", place, "--by", by, code=1)
    content = content_of(place)
    if by == "images":
        assert content["verdict"] == "refused"
    else:
        assert content["n_images"] == 0
        assert content["n_images_compared"] == 24
        assert content["images_not_matched"][0] == "P01I01"
        assert codes(content) == {"images-not-matched"}


@pytest.mark.parametrize(
    ("by", "angle_deg", "verdict"),
    [
        ("both", 0.3, "doubtful"),
        slow("images", 0.3, "doubtful"),
        slow("both", 2.0, "refused"),
        slow("images", 2.0, "refused"),
    ],
)
def test_states_turned_against_their_maplets_are_not_used_in_silence(
    workspace, tmp_path, by, angle_deg, verdict
):
    """Every image matches, and `both` would give out a rotation that is that of neither kind."""
    place = turned_states(workspace[0], tmp_path / "WS", angle_deg)
    call("register", place, "--by", by, code=1)
    content = content_of(place)
    assert content["verdict"] == verdict
    assert "images-disagree" in codes(content)


def test_the_default_is_topography_and_a_wrong_function_is_refused(workspace, found):
    _, content = found["topography"]
    assert content["by"] == "topography"
    assert "n_images" not in content
    path = workspace[0] / "spcola.toml"
    text = path.read_text().replace('by = "both"', 'by = "images"')
    path.write_text(text.replace('"lunar-lambert"', '"moonish"'))
    assert "'moonish' is none of" in call("register", workspace[0], code=1).output
    path.write_text(text)


def test_the_photometric_function_of_the_images_is_preferred(workspace):
    """They were made with the lunar-Lambert function of McEwen's numbers."""
    mcewen = "lunar-lambert a=-0.019 b=2.42e-4 c=-1.46e-6"
    given = ["--function", mcewen, "--function", "lambert", "--function", "minnaert"]
    content = called("photometry", "fit", workspace[0], *given)
    (found,) = content["filters"]
    best = found["functions"][0]
    assert best["setting"] == "lunar-lambert a=-0.019 b=0.000242 c=-1.46e-06"
    assert "lambert" not in found["as_good"]
    assert 50 < found["n_independent"] < found["n_samples"]
    k = next(one for one in found["functions"] if one["name"] == "minnaert")["parameters"]["k"]
    assert 0.4 < k["value"] < 0.8
    written = json.loads((workspace[0] / "photometry.json").read_text())
    assert written["filters"] == content["filters"]
    assert set(written) == {key for key in PHOTOMETRY_KEYS if "[" not in key}
    held = called("photometry", "fit", workspace[0], "--function", "minnaert k_slope=0")
    assert list(held["filters"][0]["functions"][0]["parameters"]) == ["k"]
    # The line that is printed is a setting.
    set_keys(workspace[0], "register", photometry=held["filters"][0]["setting"])
    assert Workspace.open(workspace[0]).settings().registration.photometry.startswith("minnaert k=")
    set_keys(workspace[0], "register", photometry="lunar-lambert")
    assert "no image is of the filter" in refused(
        "photometry", "fit", workspace[0], "--filter", "v"
    )
    assert "is none of" in refused("photometry", "fit", workspace[0], "--function", "moonish")
