"""The documents name what exists: modules, functions, constants, equations."""

from __future__ import annotations

import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1] / "docs"
NAME = re.compile(r"`(?!spcola\.toml`)((?:spcola|lidar|fusion)(?:\.\w+)+)`")
CONSTANT = re.compile(r"^\| `((?:spcola|lidar|fusion)(?:\.\w+)+)` \| (\S+) \|", re.MULTILINE)
BRACKET = re.compile(r"\[([\d–, ]+)\]")


def found(name: str) -> Any:
    """Import the modules at the head of a dotted name and return what the rest of it names."""
    head, *rest = name.split(".")
    value: Any = import_module(head)
    for part in rest:
        if hasattr(value, "__path__") and find_spec(f"{value.__name__}.{part}"):
            value = import_module(f"{value.__name__}.{part}")
            continue
        # Fields of a pydantic model are no attributes of the class.
        fields = getattr(value, "model_fields", {})
        value = fields[part].default if part in fields else getattr(value, part)
    return value


def matches(pattern: re.Pattern[str]) -> list[tuple[str, Any]]:
    """Every match of `pattern` with the name of its document, once for each document."""
    return [
        (path.name, match)
        for path in sorted(DOCS.glob("*.md"))
        for match in sorted(set(pattern.findall(path.read_text(encoding="utf-8"))))
    ]


def test_every_name_can_be_imported() -> None:
    missing = []
    for document, name in matches(NAME):
        try:
            found(name)
        except (ImportError, AttributeError) as error:
            missing.append(f"{document}: {name}: {error}")
    assert not missing
    assert len(matches(NAME)) > 100


def test_every_constant_has_the_value_of_the_code() -> None:
    other = []
    for document, (name, stated) in matches(CONSTANT):
        value = found(name)
        if (value if isinstance(value, str) else float(value)) != type(value)(stated):
            other.append(f"{document}: {name} is {value}, not {stated}")
    assert not other
    assert len(matches(CONSTANT)) > 100


def test_every_equation_is_spoken_of() -> None:
    text = (DOCS / "mathematics.md").read_text(encoding="utf-8")
    spoken: set[int] = set()
    for numbers in BRACKET.findall(text):
        for part in numbers.split(","):
            ends = [int(end) for end in part.split("–")]
            spoken.update(range(ends[0], ends[-1] + 1))
    assert set(range(1, 37)) <= spoken


def test_every_link_leads_to_a_file() -> None:
    for path in DOCS.glob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)\)", path.read_text(encoding="utf-8")):
            assert (path.parent / target).exists(), f"{path.name}: {target}"
