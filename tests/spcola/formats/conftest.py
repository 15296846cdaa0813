"""Corrupting every line of a good file once: what all text formats must survive."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from spcola.errors import FormatError

Corruptions = Iterator[tuple[str, str]]


def corruptions(text: str) -> Corruptions:
    """Yield (what was done, corrupted text): each line deleted, garbled, cut, and last."""
    lines = text.splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        before, after = lines[: number - 1], lines[number:]
        body = line.rstrip("\n")
        changes = {
            "deleted": [],
            "garbled": [re.sub(r"\d", "x", body, count=1) + "\n"],
            "cut": [body[: len(body) // 2] + "\n"],
        }
        for what, change in changes.items():
            corrupted = "".join([*before, *change, *after])
            if corrupted != text:
                yield f"line {number} {what}", corrupted
        if after:
            yield f"truncated after line {number}", "".join([*before, line])


def outcome(call: Callable[[], Any]) -> tuple[Any, str | None]:
    """Return what `call` returned, and the text of its FormatError, if it raised one."""
    try:
        return call(), None
    except FormatError as error:
        return None, str(error)


@pytest.fixture
def every_corruption_is_seen(tmp_path: Path) -> Callable[..., None]:
    """Return a check: whatever line of a good file is corrupted, the reader reports it.

    Where the corrupted text still is a good file, what is read from it must differ from what the
    good one holds; `dump` turns what was read into something comparable.
    """

    def check(text: str, read: Callable, dump: Callable, name: str = "bad.txt") -> None:
        path = tmp_path / name
        path.write_text(text)
        good = dump(read(path))
        refused = 0
        for what, corrupted in corruptions(text):
            path.write_text(corrupted)
            found, refusal = outcome(lambda: dump(read(path)))
            if refusal is None:
                assert found != good, f"{what} went unseen"
                continue
            refused += 1
            assert name in refusal, what
            assert re.search(r"line|is empty|holds no", refusal), f"{what}: {refusal}"
            assert "\n" not in refusal
        assert refused > 0

    return check
