"""Table of the blur of images, by its bytes."""

from __future__ import annotations

import pytest

from spcola.errors import FormatError
from spcola.formats.image_blurs import read_image_blurs
from spcola.photometry.image_blur import ImageBlur

HEADER = b"image,psf_px,smear_sample_px,smear_line_px\n"
IMAGES = ["N1", "N2", "W1"]


def read(tmp_path, content):
    path = tmp_path / "blur.csv"
    path.write_bytes(content)
    return read_image_blurs(path, IMAGES)


def test_patterns_and_names_give_the_blur_of_images(tmp_path):
    blurs = read(
        tmp_path,
        b"# narrow and wide camera\n" + HEADER + b"N*,0.5,0,0\n\nW1 , 0.8 , -1.5, 2D0\nN2,.5,3,0\n",
    )
    assert blurs.of("N1") == ImageBlur(0.5)
    assert blurs.of("N2") == ImageBlur(0.5, (3.0, 0.0))
    assert blurs.of("W1") == ImageBlur(0.8, (-1.5, 2.0))


def test_other_separators_orders_and_columns_are_read(tmp_path):
    table = b"Smear_line_px\tsmear_sample_px\tpsf_px\tname\tremark\n2\t1\t0.5\tN*\tdrift\n"
    assert read(tmp_path, table).of("N1") == ImageBlur(0.5, (1.0, 2.0))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (b"N1,wide,0,0\n", "line 2, column psf_px: 'wide' is not a number"),
        (b"N1,0.5,0,0\nN2,0.5,0,\n", "line 3, column smear_line_px: '' is not a number"),
        (b"N1,nan,0,0\n", "line 2, column psf_px: 'nan' is not a number"),
        (b"N1,0.5,0\n", "line 2: has 3 values for 4 columns"),
        (b"N1,-1,0,0\n", "line 2, column psf_px: must be 0 to 10 pixels, not -1"),
        (b"N1,11,0,0\n", "line 2, column psf_px: must be 0 to 10 pixels, not 11"),
        (
            b"N1,0.5,90,90\n",
            "line 2, column smear_sample_px and smear_line_px: must be a path of 100 pixels at "
            "most, not 127.279; state it in pixels of the image",
        ),
        (b"N1,0.5,0,0\nN1,0.6,0,0\n", "line 3: N1 appears twice"),
        (b",0.5,0,0\n", "line 2: names no image"),
        (b"N1,0.5,0,0\nX*,0.5,0,0\n", "line 3, column image: X* names no image; correct it"),
        (b"n1,0.5,0,0\n", "line 2, column image: n1 names no image"),
        (b"N?,0.5,0,0\n", "line 2, column image: N? names no image"),
        (
            b"N*,0.5,0,0\n*1,0.6,0,0\n",
            "line 3, column image: *1 names N1, as N* does in line 2; add a row for N1",
        ),
        (b"", "has no header and rows"),
    ],
)
def test_a_wrong_row_is_named_with_its_line_and_column(tmp_path, rows, words):
    with pytest.raises(FormatError) as error:
        read(tmp_path, HEADER + rows)
    assert words in str(error.value)
    assert "blur.csv" in str(error.value)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (b"image,psf_px,smear_sample_px\nN1,0,0\n", "line 2: has no column smear_line_px"),
        (b"image,width\nN1,0.5\n", "has no column psf_px; it needs image, psf_px, smear_sample"),
        (b"psf_px,smear_sample_px,smear_line_px\n0,0,0\n", "line 2: names no image"),
        (b"\xff\xfe\x00,\n", "is not text"),
        (HEADER.replace(b"psf_px", b"image") + b"N1,N1,0,0\n", "two columns of one name"),
    ],
)
def test_a_table_without_the_columns_is_refused(tmp_path, table, words):
    with pytest.raises(FormatError, match=words):
        read(tmp_path, table)


def test_a_pattern_may_be_ambiguous_where_a_name_decides(tmp_path):
    blurs = read(tmp_path, HEADER + b"N*,0.5,0,0\n*1,0.6,0,0\nN1,0.7,0,0\n")
    assert blurs.of("N1") == ImageBlur(0.7)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FormatError, match=r"blur\.csv"):
        read_image_blurs(tmp_path / "blur.csv", IMAGES)
