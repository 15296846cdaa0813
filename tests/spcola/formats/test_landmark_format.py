"""The .LMK format."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from spcola.camera import ImagePoint
from spcola.control import Landmark, MapOverlap
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.solution import read_landmark, write_landmark
from spcola.grids import MapletGrid

GOOD = """\
FA0115   T
      49   0.0000500                                           SIZE, SCALE(KM)
        -1        -1         3        -1                       HORIZON
    0.5000000000D-02    0.1458559361D+01                       SIGKM, RMSLMK
    0.2182154009D+00    0.4798117875D-01   -0.4244737920D-01   VLM
    0.6000000000D+00    0.8000000000D+00    0.0000000000D+00   UX
   -0.8000000000D+00    0.6000000000D+00    0.0000000000D+00   UY
    0.0000000000D+00    0.0000000000D+00    0.1000000000D+01   UZ
    0.5522198847D-03    0.4966854144D-03    0.6491137634D-03   SIGMA_LMK
PICTURES
N46299874022    204.85    502.49
N46402766222    655.45   -481.78 *
MAP OVERLAPS
FC0098    -12.50     33.25      0.75
FC0099      2.50    -33.25     -0.75
LIMB FITS
N46402766223      5.45    481.78      1.25
END FILE
"""


def read_text(tmp_path, text):
    path = tmp_path / "FA0115.LMK"
    path.write_text(text)
    return read_landmark(path)


def dump(landmark, tmp_path):
    path = tmp_path / "written"
    write_landmark(path, landmark)
    return path.read_text()


def test_every_field_in_si(tmp_path):
    landmark = read_text(tmp_path, GOOD)
    assert (landmark.name, landmark.status) == ("FA0115", "T")
    assert (landmark.grid.half_size, landmark.grid.gsd) == (49, 0.05)
    assert landmark.horizon == (-1, -1, 3, -1)
    assert (landmark.prior_sigma, landmark.rms) == (5.0, 1.458559361)
    np.testing.assert_allclose(landmark.grid.center, [218.2154009, 47.98117875, -42.4473792])
    np.testing.assert_array_equal(landmark.grid.axes, [[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    np.testing.assert_allclose(landmark.sigma, [0.5522198847, 0.4966854144, 0.6491137634])
    assert landmark.pictures == (
        ImagePoint("N46299874022", 204.85, 502.49),
        ImagePoint("N46402766222", 655.45, -481.78, deweighted=True),
    )
    assert landmark.overlaps == (
        MapOverlap("FC0098", -12.5, 33.25, 0.75),
        MapOverlap("FC0099", 2.5, -33.25, -0.75),
    )
    assert landmark.limbs == (ImagePoint("N46402766223", 5.45, 481.78, extra=("1.25",)),)


def test_written_as_read(tmp_path):
    assert dump(read_text(tmp_path, GOOD), tmp_path) == GOOD


def test_the_misspelled_sigma_and_absent_sections_are_read(tmp_path):
    lines = GOOD.replace("SIGMA_LMK", "SIMGA_LMK").splitlines(keepends=True)
    landmark = read_text(tmp_path, "".join(lines[:9]) + "END FILE\n")
    assert landmark.sigma[0] == pytest.approx(0.5522198847)
    assert landmark.pictures == landmark.overlaps == landmark.limbs == ()


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["FA0115", "FC0098", "GD0036"])
def test_the_real_files_are_rewritten_byte_for_byte(shared_data, tmp_path, name):
    path = shared_data / "rosetta_67p" / f"{name}.LMK"
    landmark = read_landmark(path)
    assert landmark.name == name
    assert landmark.grid.gsd == 10.0
    write_landmark(tmp_path / "again.LMK", landmark)
    assert (tmp_path / "again.LMK").read_bytes() == path.read_bytes()


def test_every_corrupted_line_is_seen(every_corruption_is_seen, tmp_path):
    every_corruption_is_seen(GOOD, read_landmark, lambda mark: dump(mark, tmp_path), "X.LMK")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("FA0115   T", "FA01155  T", r"line 1: landmark name .* 7 characters"),
        ("FA0115   T", "FA0115   T F", r"line 1: expected a name and a one-letter status"),
        ("      49", "     4.9", r"line 2: SIZE.*whole number"),
        ("      49", "       0", r"line 2: SIZE.*1 … 65535"),
        ("0.0000500", "-0.000050", r"line 2: SCALE"),
        ("0.0000500", "5.0000000", r"lines 2 and 5: GSD .*is it in metres"),
        ("0.0000500", "500.00000", r"lines 2 and 5: GSD of 500 km"),
        ("        -1         3", "       -.5         3", r"line 3: HORIZON needs whole numbers"),
        ("0.2182154009D+00", "0.2182154009D+07", r"lines 2 and 5: V lies 2.18215e\+06 km"),
        ("0.2182154009D+00", "             NaN", r"line 5: .*'NaN'"),
        ("0.1000000000D+01   UZ", "0.2000000000D+01   UZ", r"line 8: UZ has length 2"),
        ("-0.8000000000D+00    0.6", " 0.8000000000D+00    0.6", r"lines 6-8: .*not orthonormal"),
        ("N46402766222 ", "N46299874022 ", r"line 12: N46299874022 appears twice under PICTURES"),
        ("FC0099", "FC0098", r"line 15: FC0098 appears twice under MAP OVERLAPS"),
        ("     0.75", "", r"line 14: expected a name and three numbers"),
        ("MAP OVERLAPS", "MAP LAPS", r"line 13: 'MAP LAPS' is none of the headings"),
        ("END FILE\n", "", r"line 18: the file ends where END FILE should be"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(FormatError, match=message) as caught:
        read_text(tmp_path, GOOD.replace(old, new, 1))
    assert "FA0115.LMK" in str(caught.value)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4))
def test_round_trip_of_any_landmark(tmp_path_factory, seed, count):
    rng = np.random.default_rng(seed)
    away = rng.normal(size=3)
    landmark = Landmark(
        "AA0001",
        MapletGrid(
            # No nearer than a tenth of the largest half-side: that is refused as a wrong unit.
            rng.uniform(300.0, 3000.0) * away / np.linalg.norm(away),
            Rotation.random(rng=rng).as_matrix(),
            float(10 ** rng.uniform(-2, 1)),
            int(rng.integers(1, 200)),
        ),
        sigma=rng.uniform(0, 5, 3) if rng.random() < 0.5 else np.full(3, np.nan),
        prior_sigma=float(rng.uniform(0, 10)) if rng.random() < 0.5 else float("nan"),
        rms=float(rng.uniform(0, 10)),
        overlaps=tuple(
            MapOverlap(f"BB{k:04d}", *rng.uniform(-99, 99, 3).round(2)) for k in range(count)
        ),
    )
    path = tmp_path_factory.mktemp("lmk") / "A.LMK"
    write_landmark(path, landmark)
    back = read_landmark(path)
    assert (back.name, back.overlaps) == (landmark.name, landmark.overlaps)
    assert back.grid.gsd == pytest.approx(landmark.grid.gsd, rel=1e-9)
    np.testing.assert_allclose(back.grid.center, landmark.grid.center, rtol=5.01e-10)
    np.testing.assert_allclose(back.grid.axes, landmark.grid.axes, rtol=5.01e-10)
    np.testing.assert_allclose(back.sigma, landmark.sigma, rtol=5.01e-10)
    np.testing.assert_allclose(back.prior_sigma, landmark.prior_sigma, rtol=5.01e-10)
    first = path.read_bytes()
    write_landmark(path, back)
    assert path.read_bytes() == first


@settings(max_examples=200)
@given(
    numbers=st.lists(
        st.floats(-1e6, 1e6, exclude_min=True, exclude_max=True), min_size=3, max_size=3
    )
)
def test_overlaps_are_read_as_they_were_written(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("lmk") / "A.LMK"
    landmark = read_text(path.parent, GOOD)
    overlap = MapOverlap("FC0098", *numbers)
    write_landmark(path, dataclasses.replace(landmark, overlaps=(overlap,)))
    assert read_landmark(path).overlaps == (overlap,)


def test_overlaps_keep_their_columns_and_their_decimals(tmp_path):
    numbers = (66.076, -12.5, 0.1)
    landmark = dataclasses.replace(
        read_text(tmp_path, GOOD), overlaps=(MapOverlap("FC0098", *numbers),)
    )
    write_landmark(tmp_path / "B.LMK", landmark)
    assert b"\nFC0098    66.076    -12.50      0.10\n" in (tmp_path / "B.LMK").read_bytes()


@pytest.mark.parametrize(
    "change",
    [
        {"name": "TOOLONG"},
        {"pictures": (ImagePoint("N4629987402233", 1, 2),)},
        {"overlaps": (MapOverlap("TOOLONG", 1, 2, 3),)},
        {"pictures": (ImagePoint("N46299874022", float("nan"), 2),)},
        {"overlaps": (MapOverlap("FC0098", 1, 2, float("inf")),)},
    ],
)
def test_what_spc_cannot_hold_is_not_written(tmp_path, change):
    landmark = dataclasses.replace(read_text(tmp_path, GOOD), **change)
    with pytest.raises(InvalidValueError, match=r"characters|do not fit"):
        write_landmark(tmp_path / "A", landmark)
    assert not (tmp_path / "A").exists()
