"""Common parts of text formats: numbers, lines, columns, and errors with their place."""

from spcola.formats.text.columns import WordTable, read_words
from spcola.formats.text.fortran import LARGEST_NUMBER, parse_number
from spcola.formats.text.source import KM, read_bytes, regular_size, whole_number

__all__ = [
    "KM",
    "LARGEST_NUMBER",
    "WordTable",
    "parse_number",
    "read_bytes",
    "read_words",
    "regular_size",
    "whole_number",
]
