"""Image data (.DAT) and lists of names."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images import read_image_data, write_image_data
from spcola.formats.solution import read_list, write_list


def scene(dtype: type, peak: int) -> np.ndarray:
    """A lit sphere with noise: neighbours are alike."""
    line, pixel = np.mgrid[0:40, 0:60]
    light = np.clip(1.0 - ((line - 20) / 18) ** 2 - ((pixel - 30) / 25) ** 2, 0, None)
    noise = np.random.default_rng(1).uniform(0, 0.01, light.shape)
    return (peak * (0.98 * np.sqrt(light) + noise)).astype(dtype)


@pytest.mark.parametrize("order", [">", "<"])
@pytest.mark.parametrize("peak", [200, 4095, 65535])
def test_the_byte_order_of_16_bit_data_is_recognised(tmp_path, order, peak):
    pixels = scene(np.uint16, peak)
    path = tmp_path / "A.DAT"
    path.write_bytes(pixels.astype(f"{order}u2").tobytes())
    back = read_image_data(path, 60, 40)
    assert back.dtype == np.uint16
    np.testing.assert_array_equal(back, pixels)
    write_image_data(tmp_path / "B.DAT", back, byte_order=order)
    assert (tmp_path / "B.DAT").read_bytes() == path.read_bytes()


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.integers(2, 9), st.integers(1, 65535))
def test_the_order_is_that_in_which_neighbours_differ_less_than_half_as_much(seed, rows, cols, top):
    pixels = np.random.default_rng(seed).integers(0, top + 1, (rows, cols), dtype=np.uint16)
    content = pixels.astype(">u2").tobytes()

    def differences(order: str) -> int:
        read = np.frombuffer(content, f"{order}u2").reshape(rows, cols).astype(np.int64)
        return int(np.abs(np.diff(read, axis=0)).sum() + np.abs(np.diff(read, axis=1)).sum())

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "A.DAT"
        path.write_bytes(content)
        right = "<" if differences("<") < 0.5 * differences(">") else ">"
        there = np.frombuffer(content, f"{right}u2").reshape(rows, cols)
        np.testing.assert_array_equal(read_image_data(path, cols, rows), there)


def test_most_significant_first_where_undetermined(tmp_path):
    path = tmp_path / "A.DAT"
    path.write_bytes(b"\x01\x00" * 6)
    assert read_image_data(path, 3, 2).tolist() == [[256] * 3] * 2
    assert read_image_data(path, 3, 2, byte_order="<").tolist() == [[1] * 3] * 2


def test_8_bit_data(tmp_path):
    pixels = scene(np.uint8, 255)
    write_image_data(tmp_path / "A.DAT", pixels)
    assert (tmp_path / "A.DAT").read_bytes() == pixels.tobytes()
    np.testing.assert_array_equal(read_image_data(tmp_path / "A.DAT", 60, 40), pixels)


@pytest.mark.parametrize("length", [0, 1, 11, 13, 23, 25])
def test_data_of_another_length_are_refused(tmp_path, length):
    path = tmp_path / "A.DAT"
    path.write_bytes(bytes(length))
    with pytest.raises(FormatError, match=r"A\.DAT: (is empty|has \d+ bytes, 4 × 3 pixels)"):
        read_image_data(path, 4, 3)


@pytest.mark.parametrize("pixels", [np.zeros((2, 2)), np.zeros(4, np.uint8), np.zeros((2, 2), int)])
def test_pixels_of_another_type_are_not_written(tmp_path, pixels):
    with pytest.raises(InvalidValueError, match="uint8 or uint16"):
        write_image_data(tmp_path / "A.DAT", pixels)


def test_a_list_ends_with_end(tmp_path):
    path = tmp_path / "PICTLIST.TXT"
    path.write_text("N46299874022\n  P600069148F2\nEND\nkept for another day\n")
    assert read_list(path) == ["N46299874022", "P600069148F2"]
    write_list(path, ["A1", "B2"])
    assert path.read_text() == "A1\nB2\nEND\n"
    write_list(path, [])
    assert read_list(path) == []


@given(st.lists(st.from_regex(r"[A-Z0-9_]{1,6}", fullmatch=True), unique=True))
def test_lists_round_trip(tmp_path_factory, names):
    names = [name for name in names if name != "END"]
    path = tmp_path_factory.mktemp("list") / "LMRKLIST.TXT"
    write_list(path, names, kind="landmark")
    assert read_list(path, kind="landmark") == names


def test_every_corrupted_line_of_a_list_is_seen(every_corruption_is_seen):
    every_corruption_is_seen("AA0001\nAA0002\nBB0001\nEND\n", read_list, list, "PICTLIST.TXT")


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("AA0001\nAA0002\n", "landmark", r"line 3: the file ends where END should be"),
        ("AA0001\nAA0001\nEND\n", "landmark", r"line 2: AA0001 appears twice, first on line 1"),
        ("AA0001\n\nEND\n", "landmark", r"line 2: landmark name '' has 0"),
        ("AA0001 AA0002\nEND\n", "image", r"line 1: image name 'AA0001 AA0002'"),
        ("AA00011\nEND\n", "landmark", r"line 1: landmark name .* 7 characters"),
        ("AA\u00e40001\nEND\n", "image", r"line 1: holds byte 0xc3, which is not text"),
    ],
)
def test_what_is_wrong_in_a_list_is_named(tmp_path, text, kind, message):
    path = tmp_path / "LIST.TXT"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FormatError, match=message):
        read_list(path, kind=kind)


@pytest.mark.parametrize("names", [["AA0001", "AA0001"], ["END"], ["AA00011"], ["A/B"], [""]])
def test_lists_that_could_not_be_read_are_not_written(tmp_path, names):
    with pytest.raises(InvalidValueError):
        write_list(tmp_path / "LIST.TXT", names, kind="landmark")
    assert not list(tmp_path.iterdir())
