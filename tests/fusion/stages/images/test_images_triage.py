"""``spcola images --report``: planted orientations, states and flaws are found."""

from __future__ import annotations

import numpy as np
import pytest
from astropy.io import fits

import spcola
from fusion.stages.images import Turn
from fusion.workspace import new_workspace
from spcola.formats.images import read_image_data, write_image_data

from .box_mission import CAMERA, SIZE, call, content, files, fits_file, image_at, refusal, states


def test_triage_finds_planted_orientations_and_flags(given, made, tmp_path):
    call("images", made.root, *files(given), *states(given))
    call("images", made.root, "--report", "--thumbnails")
    found = content("images", made.root, "--report")
    assert found["counts"]["limb"] == 6
    assert found["orientations"] == {"as-stored": 6}
    assert max(found["offset_rms_px"]) < 0.5
    for number, one in enumerate(found["images"]):
        planted = image_at(number)
        assert one["resolution_m"] == pytest.approx(one["range_m"] * CAMERA.pixel_angle)
        assert one["range_m"] == pytest.approx(70_000.0, abs=300.0)
        away = planted.position / np.linalg.norm(planted.position)
        phase = np.degrees(np.arccos(away @ planted.sun))
        assert one["phase_deg"] == pytest.approx(phase, abs=0.2)
        assert one["fit"]["overlap"] > 0.95
        assert not one["flags"]
    page = (made.root / "images.html").read_text()
    assert page.count("<img") == 0
    assert all(one["name"] in page for one in found["images"])


@pytest.mark.parametrize("turn", [Turn.MIRRORED_SAMPLES, Turn.HALF_TURN, Turn.TRANSPOSED])
def test_a_turned_image_is_named_and_comes_in_right(given, made, tmp_path, turn):
    with fits.open(files(given, 0)[0]) as opened:
        dn = opened[0].data.astype(np.uint16)
    path = fits_file(tmp_path / "frame_of_a_mission_0.fit", turn.orientation.undo(dn))
    (record,) = content("images", made.root, path, *states(given))["new"]
    found = content("images", made.root, "--report")
    (one,) = found["images"]
    assert one["fit"]["turn"] == str(turn)
    assert one["flags"] == ["mirrored" if turn.mirrored else "turned"]
    (line,) = found["doubtful"]
    assert f"--orientation {turn}" in line
    for part in (made.exposure_path(record["name"]), made.image_path(record["name"])):
        part.unlink()
    call("images", made.root, path, *states(given), "--orientation", turn)
    np.testing.assert_array_equal(
        read_image_data(made.exposure_path(record["name"]), SIZE, SIZE), dn
    )
    (one,) = content("images", made.root, "--report")["images"]
    assert one["fit"]["turn"] == "as-stored"
    assert not one["flags"]


def test_a_kept_result_is_not_used_for_other_pixels_or_versions(given, made, monkeypatch):
    call("images", made.root, files(given, 0)[0], *states(given), "--report")
    folder = made.root / ".items" / "triage"
    (kept,) = folder.iterdir()
    call("images", made.root, "--report")
    assert list(folder.iterdir()) == [kept]
    (name,) = made.image_names()
    dn = read_image_data(made.exposure_path(name), SIZE, SIZE)
    made.exposure_path(name).unlink()
    write_image_data(made.exposure_path(name), dn[:, ::-1].copy())
    (one,) = content("images", made.root, "--report")["images"]
    assert one["flags"] == ["mirrored"]
    before = set(folder.iterdir())
    monkeypatch.setattr(spcola, "__version__", "of tomorrow")
    call("images", made.root, "--report")
    assert len(set(folder.iterdir()) - before) == 1


def test_empty_overexposed_and_smeared_frames_are_flagged(given, made, tmp_path):
    rng = np.random.default_rng(4)
    with fits.open(files(given, 0)[0]) as opened:
        dn = opened[0].data.astype(float)
    size = 256
    wide = np.kron(dn, np.ones((2, 2))) + rng.normal(0, 3, (size, size))
    frames = {
        "noise": rng.normal(300, 10, (size, size)),
        "over": np.minimum(2.0 * wide, 3000.0),
        "smear": wide + 0.4 * np.clip(wide - 300.0, 0, None).mean(axis=0),
        "black": np.zeros((size, size)),
        "good": wide,
    }
    for name, frame in frames.items():
        fits_file(tmp_path / f"{name}.fit", frame.astype(np.uint16))
    call("images", made.root, *(tmp_path / f"{name}.fit" for name in frames))
    found = content("images", made.root, "--report")
    flags = {one["name"]: set(one["flags"]) - {"no state"} for one in found["images"]}
    assert flags == {
        "noise": {"empty"}, "over": {"overexposed"}, "smear": {"smeared"}, "black": {"empty"},
        "good": set(),
    }  # fmt: skip
    scenes = {one["name"]: one["scene"] for one in found["images"]}
    assert scenes["noise"] == scenes["black"] == "no body"
    assert scenes["good"] == "limb"


def wrong_table(given, folder, changed):
    """The table of poses with rows changed: by number, what is done to V0, axes and Sun."""
    head, *rows = [line.split(",") for line in (given / "poses.csv").read_text().splitlines()]
    for number, change in changed.items():
        values = np.array([float(word) for word in rows[number][2:]])
        v0, axes, sun = change(values[:3], values[3:12].reshape(3, 3), values[12:])
        rows[number][2:] = [repr(float(v)) for v in [*v0, *np.ravel(axes), *sun]]
    path = folder / "wrong.csv"
    path.write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    return ["--poses", path, "--camera", given / "camera.toml"]


def test_the_likely_mistake_in_each_state_is_named(given, made, tmp_path):
    others = [image_at(number) for number in range(6)]
    table = wrong_table(given, tmp_path, {
        0: lambda v0, axes, sun: (-v0, axes, sun),
        1: lambda v0, axes, sun: (v0, axes, -sun),
        2: lambda v0, axes, sun: (v0, axes.T, sun),
        3: lambda v0, axes, sun: (v0, np.diag([1, -1, -1]) @ axes, sun),
        4: lambda *_: (others[5].scobj, others[5].axes, others[5].sun),
        5: lambda *_: (others[4].scobj, others[4].axes, others[4].sun),
    })  # fmt: skip
    found = content("images", made.root, *files(given), *table, "--report")
    away = next(one for one in found["doubts"] if one["code"] == "looks-away")
    names = [one["name"] for one in found["new"]]
    assert set(away["images"]) == {names[0], names[2], names[3]}
    assert "[looks-away]" in away["text"]
    likely = {one["name"]: one["likely"] for one in found["images"]}
    codes = ["v0-reversed", "sun-reversed", "axes-transposed", "cy-cz-reversed"]
    assert [likely[name]["code"] for name in names] == [*codes, "other-image", "other-image"]
    assert [likely[name]["image"] for name in names[4:]] == [names[5], names[4]]
    assert min(one["correlation"] for one in likely.values()) > 0.9
    assert all("wrong state" in one["flags"] for one in found["images"])
    assert found["likely"]["other-image"] == 2
    assert len(found["doubtful"]) == 6


def test_wrong_units_are_refused_or_named(given, made, tmp_path):
    close = wrong_table(given, tmp_path, {1: lambda v0, axes, sun: (v0 / 1e3, axes, sun)})
    line = refusal("images", made.root, *files(given), *close)
    assert "wrong.csv: one image" in line
    assert "inside the body [inside-body]; likely V0 is 1000 times too short" in line
    assert not list(made.root.glob("IMAGEFILES/*"))
    far = wrong_table(given, tmp_path, {1: lambda v0, axes, sun: (v0 * 1e3, axes, sun)})
    found = content("images", made.root, *files(given, 1), *far, "--report")
    (doubt,) = found["doubts"]
    assert (doubt["code"], doubt["likely"]) == ("below-a-pixel", ["m-as-km"])
    assert found["images"][0]["likely"]["code"] == "m-as-km"


def test_a_camera_that_looks_away_is_named_without_a_shape_too(given, tmp_path):
    bare = new_workspace(tmp_path / "bare", body="Box")
    table = wrong_table(given, tmp_path, {1: lambda v0, axes, sun: (-v0, axes, sun)})
    (doubt,) = content("images", bare.root, *files(given), *table)["doubts"]
    assert (doubt["code"], len(doubt["images"])) == ("looks-away", 1)
