"""Fields of structured files (JSON, TOML), with their place in errors."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text.fortran import LARGEST_NUMBER
from spcola.formats.text.source import read_bytes

# More lines than any image has; tables of states for them fit into memory.
_LARGEST_SIDE = 1 << 22


@dataclass(frozen=True)
class Fields:
    """The content of a file, by dotted names such as ``focal_length_model.focal_length``.

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    content : mapping
    """

    path: Path
    content: Mapping[str, Any]

    @classmethod
    def read_json(cls, path: str | Path) -> Fields:
        """Read a JSON object.

        Raises
        ------
        FormatError
            If the file cannot be read or is no JSON object.
        """
        return cls._parsed(path, json.loads, "JSON")

    @classmethod
    def read_toml(cls, path: str | Path) -> Fields:
        """Read a TOML file.

        Raises
        ------
        FormatError
            If the file cannot be read or is no TOML.
        """
        return cls._parsed(path, tomllib.loads, "TOML")

    @classmethod
    def _parsed(cls, path: str | Path, parse: Any, what: str) -> Fields:
        try:
            content = parse(read_bytes(path).decode("utf-8"))
        except (ValueError, RecursionError) as error:
            raise FormatError(f"is not {what} ({error})", path) from error
        if not isinstance(content, dict):
            raise FormatError(f"is no {what} object", path)
        return cls(Path(path), content)

    def where(self, name: str) -> str:
        """Return the place of a field for messages."""
        return f"{self.path}: {name}"

    def get(self, name: str) -> Any:
        """Return a field, or None if it or a part of its name is missing or null."""
        value: Any = self.content
        for part in name.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """Return a number.

        Raises
        ------
        FormatError
            If it is missing and has no default, or is no usable number.
        """
        value = self.get(name)
        if value is None and default is not None:
            return default
        return float(self._numbers(name, value)[0])

    def whole(self, name: str) -> int:
        """Return a number of pixels: whole, from 1 to 2²².

        Raises
        ------
        FormatError
            If it is missing, or another number.
        """
        value = self.number(name)
        if value != int(value) or not 1 <= value <= _LARGEST_SIDE:
            raise FormatError(f"is {value:g}, no number of pixels", self.where(name))
        return int(value)

    def vector(self, name: str, *counts: int) -> FloatArray:
        """Return a list of numbers (N,); N is one of `counts` where they are given.

        Raises
        ------
        FormatError
            If it is missing or has another length.
        """
        numbers = self._numbers(name, self.get(name))
        if counts and len(numbers) not in counts:
            wanted = " or ".join(str(count) for count in counts)
            raise FormatError(f"has {len(numbers)} numbers, not {wanted}", self.where(name))
        return numbers

    def table(self, name: str, width: int) -> FloatArray:
        """Return a list of lists of `width` numbers (N, width).

        Raises
        ------
        FormatError
            If it is missing, or a row has another length.
        """
        value = self.get(name)
        if not isinstance(value, list) or not value:
            raise FormatError("is missing or no list", self.where(name))
        rows = [self._numbers(name, row) for row in value]
        if any(len(row) != width for row in rows):
            raise FormatError(f"has a row that is not of {width} numbers", self.where(name))
        return np.array(rows)

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text.

        Raises
        ------
        FormatError
            If it is missing and has no default, or is no text.
        """
        value = self.get(name)
        if value is None and default is not None:
            return default
        if not isinstance(value, str):
            raise FormatError("is missing or no text", self.where(name))
        return value

    def _numbers(self, name: str, value: Any) -> FloatArray:
        if value is None:
            raise FormatError("is missing", self.where(name))
        items = value if isinstance(value, list) else [value]
        usable = [
            isinstance(item, int | float)
            and not isinstance(item, bool)
            and abs(item) <= LARGEST_NUMBER
            for item in items
        ]
        if not items or not all(usable):
            raise FormatError(f"is no usable number: {value!r}", self.where(name))
        return np.array(items, dtype=np.float64)
