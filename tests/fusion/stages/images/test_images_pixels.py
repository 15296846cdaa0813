"""``spcola images``: what is done to pixels."""

from __future__ import annotations

import numpy as np
import pytest
from astropy.io import fits

from fusion.workspace import new_workspace
from spcola.formats.images import read_image_data

from .box_mission import SIZE, START, call, content, files, fits_file, refusal, states


def test_dark_flat_bits_filter_and_letter(given, made, tmp_path):
    with fits.open(files(given, 0)[0]) as opened:
        raw = opened[0].data.astype(float)
    flat = np.linspace(0.5, 1.5, SIZE)[None, :] * np.ones((SIZE, 1))
    dark = np.full((SIZE, SIZE), 200.0)
    for name, frame in (("dark.fit", dark), ("flat.fit", flat)):
        fits_file(tmp_path / name, frame)
    red = fits_file(tmp_path / "a.fit", raw.astype(np.uint16), FILTER="RED")
    blue = fits_file(tmp_path / "b.fit", raw.astype(np.uint16)[::-1], FILTER="BLUE")
    found = content(
        "images", made.root, red, blue, "--dark", tmp_path / "dark.fit", "--flat",
        tmp_path / "flat.fit", "--bits", 8, "--filter", "RED", "--letter", "Q",
    )  # fmt: skip
    assert found["filtered"] == 1
    (record,) = found["new"]
    assert record["name"].startswith("Q")
    assert record["name"].endswith("RE")
    assert record["pixels"]["bits"] == 8
    dn = read_image_data(made.exposure_path(record["name"]), SIZE, SIZE)
    bright = raw > 1000
    wanted = ((raw - 200.0) / (flat / flat.mean()) * record["pixels"]["gain"])[bright]
    np.testing.assert_allclose(dn[bright], wanted, atol=0.51)


def test_encoded_brightness_is_decoded(given, made, tmp_path):
    with fits.open(files(given, 0)[0]) as opened:
        raw = opened[0].data.astype(float)
    path = fits_file(tmp_path / "root.fit", np.rint(np.sqrt(raw)).astype(np.uint8))
    (record,) = content("images", made.root, path, "--gamma", 2)["new"]
    assert record["pixels"]["bits"] == 16
    dn = read_image_data(made.exposure_path(record["name"]), SIZE, SIZE)
    bright = raw > 1000
    wanted = np.rint(np.sqrt(raw)) ** 2 * record["pixels"]["gain"]
    np.testing.assert_allclose(dn[bright], wanted[bright], atol=0.51)
    assert "--gamma" in refusal("images", made.root, path)


def test_other_settings_for_the_same_image_are_refused(given, made):
    call("images", made.root, *files(given, 0))
    line = refusal("images", made.root, *files(given, 0), "--orientation", "mirrored-lines")
    assert "with other --dark" in line


PLAIN = """PDS_VERSION_ID = PDS3
RECORD_TYPE = FIXED_LENGTH
RECORD_BYTES = {record}
FILE_RECORDS = {size}
^IMAGE = "{name}"
START_TIME = 2019-03-03T08:54:59.913
EXPOSURE_DURATION = 20.0 <ms>
OBJECT = IMAGE
  LINES = {size}
  LINE_SAMPLES = {size}
  SAMPLE_BITS = 16
  SAMPLE_TYPE = {order}_UNSIGNED_INTEGER
END_OBJECT = IMAGE
END
"""


@pytest.mark.parametrize(("order", "size"), [("LSB", SIZE), ("MSB", SIZE + 4)])
def test_wrong_byte_order_and_size_are_one_line(given, made, tmp_path, order, size):
    with fits.open(files(given, 0)[0]) as opened:
        (tmp_path / "a.img").write_bytes(opened[0].data.astype(">u2").tobytes())
    text = PLAIN.format(record=2 * size, size=size, name="a.img", order=order)
    (tmp_path / "a.lbl").write_text(text)
    assert "a.img" in refusal("images", made.root, tmp_path / "a.lbl")
    assert not list(made.root.glob("IMAGEFILES/*"))


def test_a_table_gives_times_for_names(made, tmp_path):
    image = tmp_path / "a_very_long_name.fit"
    fits.PrimaryHDU(np.full((8, 8), 5, np.uint16)).writeto(image)
    assert "no name can be made" in refusal("images", made.root, image)
    table = tmp_path / "times.csv"
    table.write_text(f"image,et\na_very_long_name,{START}\n")
    (record,) = content("images", made.root, image, "--times", table)["new"]
    assert record["name"] == f"A{int(START):09d}"


@pytest.mark.parametrize("side", ["first-line", "last-line"])
def test_planted_smear_is_removed_with_the_exposure_time_of_the_label(given, made, tmp_path, side):
    # Moved by hand, line by line: each line collects light of all lines that it passes.
    with fits.open(files(given, 0)[0]) as opened:
        sharp = opened[0].data.astype(float)
    line_s, clearing_s, exposure_s = 2e-5, 1e-5, 0.02
    order = slice(None) if side == "first-line" else slice(None, None, -1)
    seen = sharp[order].copy()
    for line in range(SIZE):
        seen[line] += line_s / exposure_s * sharp[order][:line].sum(axis=0)
        seen[line] += clearing_s / exposure_s * sharp[order][line + 1 :].sum(axis=0)
    image = fits_file(tmp_path / "a.fit", seen[order])
    smear = ["--smear-s", line_s, "--clearing-s", clearing_s, "--memory", side]
    (record,) = content("images", made.root, image, *smear)["new"]
    dn = read_image_data(made.exposure_path(record["name"]), SIZE, SIZE)
    gain = record["pixels"]["gain"]
    np.testing.assert_allclose(dn / gain, sharp, atol=0.51 / gain)
    assert np.abs(seen[order] - sharp).max() > 30.0
    # A camera file states the same times; options win.
    camera = tmp_path / "lens.toml"
    times = {"line_s": line_s, "clearing_s": clearing_s, "memory": side}
    stated = ", ".join(f"{key} = {value!r}" for key, value in times.items()).replace("'", '"')
    head, tail = (given / "camera.toml").read_text().split("size =")
    camera.write_text(f"{head}frame_transfer = {{{stated}}}\nsize ={tail}")
    by_file = content("images", made.root, image, "--camera", camera)
    assert by_file["known"] == [record["name"]]
    assert by_file["smear"]["line_transfer_s"] == line_s
    for other in (("--smear-s", 0), ("--smear-s", 3e-5), ("--clearing-s", 0)):
        assert "with other --dark" in refusal(
            "images", made.root, image, "--camera", camera, *other
        )
    # Known pixels are not prepared in another way; a header without a time does not do.
    assert "with other --dark" in refusal("images", made.root, image)
    bare = tmp_path / "bare.fit"
    fits.PrimaryHDU(seen[order]).writeto(bare)
    assert "states no exposure time" in refusal("images", made.root, bare, *smear)
    assert "bare.fit" in refusal("images", made.root, bare, *smear, "--exposure-s", 1e-6)
    (other,) = content("images", made.root, bare, *smear, "--exposure-s", exposure_s)["new"]
    assert other["pixels"]["sha256"] == record["pixels"]["sha256"]
    call("images", made.root, image, "--clearing-s", 1.0, code=2)


def test_thresholds_of_a_body_before_a_bright_background(given, made, tmp_path):
    rng = np.random.default_rng(3)
    down, right = np.indices((SIZE, SIZE))
    body = np.hypot(down - 64, right - 40) < 30
    planet, shadow = right > 60, right < 15
    dn = np.where(planet, 3000.0, 100.0) + rng.normal(0, 20, (SIZE, SIZE))
    dn[body] = 900.0 + rng.normal(0, 60, np.count_nonzero(body))
    dn[shadow] = 100.0 + rng.normal(0, 5, np.count_nonzero(shadow))
    image = fits_file(tmp_path / "a.fit", dn.clip(0).astype(np.uint16))
    (record,) = content("images", made.root, image, "--bright-background")["new"]
    low, high = record["pixels"]["thresholds"]
    assert 150 < low < 700
    assert 1100 < high < 2950
    plain = refusal("images", made.root, files(given, 1)[0], "--bright-background")
    assert "frame_of_a_mission_1.fit: bright background" in plain
    assert "give --high DN" in plain
    (record,) = content("images", made.root, files(given, 1)[0], "--low", 300, "--high", 2000)[
        "new"
    ]
    assert record["pixels"]["thresholds"] == [300, 2000]
    line = refusal("images", made.root, files(given, 2)[0], "--high", 70)
    assert "frame_of_a_mission_2.fit: thresholds" in line
    call("images", made.root, image, "--low", 300, "--high", 200, code=2)


def test_chosen_thresholds_win_over_those_of_the_camera(given, made):
    (record,) = content("images", made.root, *files(given, 0), *states(given))["new"]
    summary = made.image_path(record["name"])
    other = new_workspace(made.root.parent / "other", body="Box")
    common = [*files(given, 1), "--poses", given / "poses.csv", "--camera", summary]
    (one,) = content("images", other.root, *common, "--low", 301, "--high", 2001)["new"]
    assert other.image(one["name"]).thresholds == (301, 2001)
