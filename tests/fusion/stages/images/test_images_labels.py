"""``spcola images --states label``: geometry in PDS labels."""

from __future__ import annotations

import numpy as np
import pytest
from astropy.io import fits

from spcola.navigation import Spin, et_from_utc

from .box_mission import SIZE, content, files, image_at, refusal

PCK = """KPL/PCK
\\begindata
BODY2000433_POLE_RA = ( 11.35 0. 0. )
BODY2000433_POLE_DEC = ( 17.22 0. 0. )
BODY2000433_PM = ( 326.07 1639.38864745 0. )
"""
LABEL = """PDS_VERSION_ID = PDS3
RECORD_TYPE = FIXED_LENGTH
RECORD_BYTES = {record}
FILE_RECORDS = {size}
^IMAGE = "a.img"
IMAGE_MID_TIME = {utc}
{geometry}OBJECT = IMAGE
  LINES = {size}
  LINE_SAMPLES = {size}
  SAMPLE_BITS = 16
  SAMPLE_TYPE = MSB_UNSIGNED_INTEGER
END_OBJECT = IMAGE
END
"""


def stated(number, *, display="DOWN"):
    """Lines of a label: vectors with metres, angles with seven digits, as labels have them."""
    image = image_at(number)
    time = et_from_utc(image.utc)
    lag = np.linalg.norm(image.position) / 299792458.0
    turn = Spin(11.35, 17.22, 326.07, 1639.38864745).axes([time - lag])[0]
    axes, ahead = image.axes @ turn, image.axes[2] @ turn
    clock = np.degrees(np.arctan2(axes[0, 2], -axes[1, 2])) % 360.0

    def vector(values):
        return "(" + ", ".join(f"{value:.6f} <km>" for value in values) + ")"

    return {
        "SC_TARGET_POSITION_VECTOR": vector(turn.T @ image.scobj / 1e3),
        "SC_SUN_POSITION_VECTOR": vector(turn.T @ (2.5e8 * image.sun + image.scobj / 1e3)),
        "RIGHT_ASCENSION": f"{np.degrees(np.arctan2(ahead[1], ahead[0])) % 360.0:.7f} <deg>",
        "DECLINATION": f"{np.degrees(np.arcsin(ahead[2])):.7f} <deg>",
        "CELESTIAL_NORTH_CLOCK_ANGLE": f"{clock:.7f} <deg>",
        "LINE_DISPLAY_DIRECTION": display,
        "SAMPLE_DISPLAY_DIRECTION": "RIGHT",
    }


def image_file(folder, given, keywords):
    with fits.open(files(given, 0)[0]) as opened:
        (folder / "a.img").write_bytes(opened[0].data.astype(">u2").tobytes())
    geometry = "".join(f"{name} = {value}\n" for name, value in keywords.items())
    utc = "2019-03-03T10:59:40"
    text = LABEL.format(record=2 * SIZE, size=SIZE, utc=utc, geometry=geometry)
    (folder / "a.lbl").write_text(text)
    (folder / "body.tpc").write_text(PCK)
    return folder / "a.lbl"


def options(given, folder):
    rotation = ["--pck", folder / "body.tpc", "--body", 2000433]
    return ["--states", "label", "--camera", given / "camera.toml", *rotation]


def test_a_planted_state_comes_back_from_a_pds3_label(given, made, tmp_path):
    label = image_file(tmp_path, given, stated(0))
    found = content("images", made.root, label, *options(given, tmp_path), "--report")
    (record,) = found["new"]
    assert record["state"]["source"] == "pds"
    assert any("read as along J2000" in note for note in record["notes"])
    assert not any("K matrix" in note for note in record["notes"])
    image, planted = made.image(record["name"]), image_at(0)
    np.testing.assert_allclose(image.scobj, planted.scobj, atol=2e-3)
    np.testing.assert_allclose(image.axes, planted.axes, atol=3e-9)
    np.testing.assert_allclose(image.sun, planted.sun, atol=1e-9)
    (one,) = found["images"]
    assert one["fit"]["turn"] == "as-stored"
    assert np.hypot(*one["fit"]["offset_px"]) < 0.5


def test_a_label_that_displays_the_lines_upwards_is_noted(given, made, tmp_path):
    label = image_file(tmp_path, given, stated(0, display="UP"))
    (record,) = content("images", made.root, label, *options(given, tmp_path))["new"]
    assert any("lines going up, the camera's K matrix" in note for note in record["notes"])


def test_what_a_label_lacks_is_named(given, made, tmp_path):
    for name in ("SC_TARGET_POSITION_VECTOR", "CELESTIAL_NORTH_CLOCK_ANGLE"):
        keywords = {k: v for k, v in stated(0).items() if k != name}
        label = image_file(tmp_path, given, keywords)
        assert f"{name} is missing" in refusal(
            "images", made.root, label, *options(given, tmp_path)
        )
    label = image_file(tmp_path, given, stated(0))
    assert "give --pck" in refusal("images", made.root, label, *options(given, tmp_path)[:4])
    assert not list(made.root.glob("IMAGEFILES/*"))


@pytest.mark.real_data
def test_the_labels_of_msi_lack_the_place_of_eros(given, made, shared_data, tmp_path):
    (tmp_path / "body.tpc").write_text(PCK)
    folder = shared_data / "eros"
    for name, missing in (
        ("m0126360726f4_2p_cif_gbl.lbl", "SC_TARGET_POSITION_VECTOR"),
        ("m0126360726f4_2p_cif_gbl.xml", "geom:Vector_Cartesian_Position_Spacecraft_To_Target"),
    ):
        line = refusal("images", made.root, folder / name, *options(given, tmp_path))
        assert f"{missing} is missing" in line
