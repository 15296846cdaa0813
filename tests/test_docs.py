"""What the documents say of the code holds; links are checked by ``scripts/docs``."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from enum import Enum
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

DOCS = Path(__file__).resolve().parents[1] / "docs"
NAME = re.compile(r"`(?!spcola\.toml`)((?:spcola|lidar|fusion)(?:\.\w+)+)`")
CONSTANT = re.compile(r"^\| `((?:spcola|lidar|fusion)(?:\.\w+)+)` \| (\S+) \|", re.MULTILINE)
EQUATION = re.compile(r"^\| \[([\d–, ]+)\]", re.MULTILINE)


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


def matches(pattern: re.Pattern[str], folder: str = ".") -> list[tuple[str, Any]]:
    """Every match of `pattern` with the name of its document, once for each document."""
    return [
        (path.name, match)
        for path in sorted((DOCS / folder).rglob("*.md"))
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


def test_every_equation_of_the_paper_has_a_function_or_is_said_to_be_missing() -> None:
    explained: set[int] = set()
    for _, numbers in matches(EQUATION, "explanation"):
        for part in numbers.split(","):
            ends = [int(end) for end in part.split("–")]
            explained.update(range(ends[0], ends[-1] + 1))
    assert explained == set(range(1, 37))


# Rooms of the program's own machinery, which no notebook calls; settings describe their fields.
MACHINERY = (
    "spcola.compilation",
    "spcola.formats.hdf5",
    "spcola.formats.map_store",
    "spcola.formats.text",
    "fusion.pipeline",
    "fusion.report",
    "fusion.runtime",
    "fusion.scaling.judging",
    "fusion.scaling.results",
    "fusion.service",
    "fusion.stages.",
    "fusion.truth",
    "fusion.workspace.settings",
)


def public_names() -> Iterator[tuple[str, Any, bool]]:
    """Functions and classes in ``__all__`` of any room, and the public methods of classes.

    The third is whether a notebook may call it: its docstring states all parameters.
    """
    for top in ("spcola", "lidar", "fusion"):
        package = import_module(top)
        modules = walk_packages(package.__path__, f"{top}.")
        files = (
            (m.name, Path(__file__).parents[1] / (m.name.replace(".", "/") + ".py"))
            for m in modules
        )
        offered = [
            name for name, path in files if not path.exists() or "\n__all__ = " in path.read_text()
        ]
        for name in [top, *offered]:
            module = import_module(name)
            for public in getattr(module, "__all__", ()):
                value = getattr(module, public)
                if not (inspect.isclass(value) or inspect.isroutine(value)):
                    continue
                yield f"{name}.{public}", value, not name.startswith(MACHINERY)
                members = vars(value) if inspect.isclass(value) else {}
                for method in members.keys() - getattr(value, "__dataclass_fields__", {}).keys():
                    function = members[method]
                    plain = getattr(function, "__func__", getattr(function, "fget", function))
                    if not method.startswith("_") and inspect.isfunction(plain):
                        yield f"{name}.{public}.{method}", plain, not name.startswith(MACHINERY)


def parameters(value: Any) -> list[str]:
    """Names of the parameters; none of an enumeration, a warning or a protocol."""
    if inspect.isclass(value) and (
        issubclass(value, Enum | Warning) or getattr(value, "_is_protocol", False)
    ):
        return []
    return list(inspect.signature(value).parameters)


def documentation(value: Any) -> str:
    """The docstring; of a class with those of the classes whose parameters it takes over."""
    kinds = inspect.getmro(value) if inspect.isclass(value) else (value,)
    return "\n".join(kind.__doc__ or "" for kind in kinds if kind is not object)


def test_every_public_name_is_documented() -> None:
    """All have a docstring; those that a notebook may call state every parameter in it."""
    silent = []
    for name, value, imported in public_names():
        said = documentation(value)
        unsaid = [
            parameter
            for parameter in (parameters(value) if imported else ())
            if parameter not in ("self", "cls") and not re.search(rf"\b{parameter}\b", said)
        ]
        if unsaid or not said:
            silent.append(f"{name}: {', '.join(unsaid) or 'no docstring'}")
    assert not silent
