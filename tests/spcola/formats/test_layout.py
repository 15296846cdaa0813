"""Text files of another writer keep their layout when they are written again."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from spcola.camera import ImagePoint
from spcola.errors import FormatError
from spcola.formats.solution import (
    read_landmark,
    read_nominal,
    read_summary,
    write_landmark,
    write_nominal,
    write_summary,
)

SUM = """\
P600069148F2
2019 MAR 03 11:22:33.456
   1024   1020    500  65535                        NPX, NLN, THRSH
  0.135680000000D+03 0.511700000000D+03 0.510600000000D+03  MMFL, CTR
 -0.1430589240123D+01 -0.38931159140D+00 8.458863431E-01     SCOBJ
   0.6 0.8 0.0 CX
   -0.8 0.6 0.0 CY
   0 0 1 CZ
    0.6000000000D+00    0.0000000000D+00    0.8000000000D+00   SZ
  37.03710   0.12400   0.00000  -0.12400 -37.03710   0.00000   K-MATRIX
    0.50000D+00 SIGPXL
    0.1000000000D-01 SIG_VSO
    0.2231524849D-03    0.2231586132D-03    0.5515340338D-03   SIG_PTG
LANDMARKS
FA0115 533.5312 475.2199
FC0098    513.55    501.38*
LIMB FITS
END FILE"""

LMK = """\
FA0115 T
  49 0.00005 SIZE, SCALE(KM)
  -1 -1 -1 -1   HORIZON
  0.5E-02  1.458559361  SIGKM, RMSLMK
  0.2182154009  0.04798117875  -0.04244737920  VLM
  0.6 0.8 0 UX
  -0.8 0.6 0 UY
  0 0 1 UZ
  0.5522198847D-03 0.4966854144D-03 0.6491137634D-03  SIMGA_LMK
PICTURES
N46299874022  204.85 502.49
MAP OVERLAPS
LIMB FITS
END FILE
"""

NOM = """\
P600069148F2
  0.1D-03 -0.2D-03 0.3D-03 J2000
 -0.1430589240123D+01 -0.38931159140D+00 8.458863431E-01     SCOBJ
  0.01 0.02 0.03 SIG_VSO
   0.6 0.8 0.0 CX
   -0.8 0.6 0.0 CY
   0 0 1 CZ
   0.001 0.002 0.003 SIGMA_PTG
   what follows  1.0
"""

CASES = {
    "A.SUM": (SUM, read_summary, write_summary),
    "A.LMK": (LMK, read_landmark, write_landmark),
    "A.NOM": (NOM, read_nominal, write_nominal),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_an_untouched_file_of_another_writer_is_rewritten_byte_for_byte(tmp_path, name, end):
    text, read, write = CASES[name]
    path = tmp_path / name
    path.write_bytes(text.replace("\n", end).encode())
    write(tmp_path / "again", read(path), like=path)
    assert (tmp_path / "again").read_bytes() == path.read_bytes()


def lines_that_differ(old: Path, new: Path) -> list[int]:
    pairs = zip(old.read_text().splitlines(), new.read_text().splitlines(), strict=True)
    return [number for number, (a, b) in enumerate(pairs, start=1) if a != b]


def test_only_what_changed_is_written_anew(tmp_path):
    path, again = tmp_path / "A.SUM", tmp_path / "again.SUM"
    path.write_text(SUM)
    image = read_summary(path)
    moved = dataclasses.replace(
        image,
        scobj=image.scobj + np.array([0.0, 0.001, 0.0]),
        landmarks=(dataclasses.replace(image.landmarks[0], pixel=533.54), image.landmarks[1]),
    )
    write_summary(again, moved, like=path)
    assert lines_that_differ(path, again) == [5, 15]
    back = read_summary(again)
    assert back.landmarks[0].pixel == 533.54
    assert back.scobj[1] == pytest.approx(moved.scobj[1], rel=1e-9)


def test_added_and_removed_observations(tmp_path):
    path, again = tmp_path / "A.SUM", tmp_path / "again.SUM"
    path.write_text(SUM)
    image = read_summary(path)
    added = (image.landmarks[1], ImagePoint("GD0036", 1.0, 2.0))
    write_summary(again, dataclasses.replace(image, landmarks=added), like=path)
    text = again.read_text()
    assert "FC0098    513.55    501.38*\nGD0036      1.00      2.00\nLIMB FITS" in text
    assert "FA0115" not in text
    assert text.startswith(SUM[: SUM.index("LANDMARKS")])


def test_a_missing_model_of_layout_is_an_error(tmp_path):
    path = tmp_path / "A.SUM"
    path.write_text(SUM)
    with pytest.raises(FormatError, match="cannot be read"):
        write_summary(tmp_path / "B.SUM", read_summary(path), like=tmp_path / "none")
