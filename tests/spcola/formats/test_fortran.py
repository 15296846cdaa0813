"""Numbers as Fortran writes them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spcola.formats.text.fortran import format_d, format_fixed, parse_number


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.5000000000D-02", 0.005),
        ("-1.34475d-01", -0.134475),
        ("5E3", 5000.0),
        (".5", 0.5),
        ("+5.", 5.0),
        ("0.1234-100", 0.1234e-100),
        ("49", 49.0),
    ],
)
def test_forms_that_are_numbers(text, value):
    assert parse_number(text) == value


@pytest.mark.parametrize(
    "text",
    ["", "x", "1x", "NaN", "Infinity", "1_0", "1D", "1.2.3", "0x1", "1D999", "--1", "1 2", "1D101"],
)
def test_forms_that_are_none(text):
    with pytest.raises(ValueError, match="is"):
        parse_number(text)


def test_an_overflowed_column_is_called_so():
    with pytest.raises(ValueError, match="overflowed its column"):
        parse_number("**********")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.005, "    0.5000000000D-02"),
        (-143.058924, "   -0.1430589240D+03"),
        (0.0, "    0.0000000000D+00"),
        (1.0, "    0.1000000000D+01"),
        (0.99999999999, "    0.1000000000D+01"),
        (float("nan"), "   -0.1000000000D+01"),
    ],
)
def test_d_format(value, text):
    assert format_d(value, 20, 10) == text


@given(st.floats(-1e99, 1e99).filter(lambda value: value == 0 or abs(value) > 1e-99))
def test_d_format_reads_back(value):
    assert parse_number(format_d(value, 20, 10).strip()) == pytest.approx(
        value, rel=5.01e-10, abs=0
    )


@given(st.floats(min_value=-1e5, max_value=1e5))
def test_fixed_format_loses_nothing(value):
    value = round(value, 12)
    text = format_fixed(value, 10, 4)
    assert text.startswith(" ")
    assert float(text) == pytest.approx(value, rel=5.01e-10, abs=1e-20)
    assert format_fixed(float(text), 10, 4) == text


def test_fixed_format_keeps_its_columns_where_they_suffice():
    assert format_fixed(37.0371, 10, 4) == "   37.0371"
    assert format_fixed(0.01, 12, 7) == "   0.0100000"
    assert format_fixed(0.0, 10, 4) == "    0.0000"
