"""Values as JSON text: arrays, numpy numbers and paths become JSON types."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spcola.errors import InvalidValueError

_PLAIN = (str, int, bool, type(None))


def json_text(content: Mapping[str, Any]) -> str:
    """Return `content` as JSON: keys sorted, arrays as lists, NaN and infinity as null.

    Raises
    ------
    InvalidValueError
        If it is nested deeper than Python follows.
    """
    try:
        text = json.dumps(json_value(content), indent=2, sort_keys=True, ensure_ascii=False)
    except RecursionError as error:
        raise InvalidValueError("is nested too deep to be written as JSON") from error
    # Bytes of a file name that are not UTF-8: Python's escape is also JSON's.
    return text.encode("utf-8", "backslashreplace").decode("utf-8") + "\n"


def json_value(value: Any) -> Any:
    """Return `value` in JSON types; NaN and infinity become None."""
    # Most values are plain ones: they are found by their types, which is fastest.
    kind = type(value)
    if kind in _PLAIN or (kind is float and math.isfinite(value)):
        return value
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    # No value is numpy's before something has imported numpy, which takes a tenth of a second.
    if (np := sys.modules.get("numpy")) and isinstance(value, np.ndarray | np.generic):
        # Values without NaN need not be looked at one by one.
        number = value.dtype.kind in "biuf"
        known = number and bool(np.isfinite(value).all())
        return value.tolist() if known else json_value(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [json_value(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def content_digest(content: Any) -> str:
    """Return the SHA-256 of JSON content, hexadecimal; the order of keys does not matter."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
