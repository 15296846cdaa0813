"""`spcola info` and `spcola look` on images of missions."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app
from PIL import Image
from typer.testing import CliRunner

from fusion.inspection import name_content
from spcola.errors import FormatError
from spcola.formats.images import open_image

LABEL = """PDS_VERSION_ID = PDS3
RECORD_TYPE = FIXED_LENGTH
RECORD_BYTES = 80
FILE_RECORDS = 30
^IMAGE = "frame.img"
TARGET_NAME = EROS
START_TIME = 2000-02-19T08:54:59.913
EXPOSURE_DURATION = 998.0 <ms>
LINE_DISPLAY_DIRECTION = UP
SAMPLE_DISPLAY_DIRECTION = RIGHT
OBJECT = IMAGE
  LINES = 30
  LINE_SAMPLES = 40
  SAMPLE_BITS = 16
  SAMPLE_TYPE = MSB_UNSIGNED_INTEGER
END_OBJECT = IMAGE
END
"""


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """The current folder, with an image and its detached label."""
    pixels = np.add.outer(np.arange(30) * 50, np.arange(40) * 9).astype(">u2")
    (tmp_path / "frame.img").write_bytes(pixels.tobytes())
    (tmp_path / "frame.lbl").write_text(LABEL)
    before = Path.cwd()
    os.chdir(tmp_path)
    yield tmp_path
    os.chdir(before)


def call(*arguments: str, code: int = 0) -> Any:
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == code, result.output
    return json.loads(result.stdout) if code == 0 else result.stderr


@pytest.mark.parametrize("name", ["frame.lbl", "frame.img"])
def test_info_of_an_image_with_a_detached_label(here: Path, name: str) -> None:
    found = call("info", name)
    assert found["kind"] == "image (PDS3, without a .SUM file)"
    assert (found["pixels"], found["lines"], found["bits"]) == (40, 30, 16)
    assert (found["pixel_file"], found["label_file"]) == ("frame.img", "frame.lbl")
    assert (found["target"], found["exposure_s"]) == ("EROS", pytest.approx(0.998))
    assert found["mid_utc"] == "2000 FEB 19 08:55:00.412"
    assert found["mid_from"] == "start_and_exposure"
    assert (found["first_pixel_shown"], found["stored_mirrored"]) == ("lower left", True)
    assert found["notes"] == []


def test_info_refuses_a_label_that_contradicts_its_pixels(here: Path) -> None:
    (here / "frame.lbl").write_text(LABEL.replace("LINES = 30", "LINES = 31"))
    error = call("info", "frame.lbl", code=1)
    assert "has 2400 bytes, its label needs 2480 (31 × 40 pixels of 2 bytes from byte 1)" in error


def test_look_draws_an_image_as_it_is_stored(here: Path) -> None:
    found = call("look", "frame.lbl")
    assert found["kind"] == "image"
    with Image.open(found["picture"]) as picture:
        assert min(picture.size) > 500


@pytest.mark.parametrize("form", ["PNG", "TIFF", "JPEG", "GIF", "VICAR"])
def test_the_advice_about_a_picture_is_what_spcola_images_does(tmp_path: Path, form: str) -> None:
    path = tmp_path / "file.dat"
    if form == "VICAR":
        path.write_bytes(b"LBLSIZE=40 FORMAT='BYTE' NL=4 NS=4".ljust(40) + bytes(range(16)))
    else:
        Image.fromarray(np.arange(16, dtype=np.uint8).reshape(4, 4)).save(path, format=form)
    _, advice = name_content(path.read_bytes())
    assert ("spcola images WS FILE" in advice) is (form in ("PNG", "TIFF"))
    if form in ("PNG", "TIFF"):
        assert open_image(path).read().values.shape == (4, 4)
    else:
        assert "convert it to TIFF or FITS" in advice
        with pytest.raises(FormatError):
            open_image(path)
