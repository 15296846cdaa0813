"""The order of the packages (spcola ← lidar ← fusion) and of the rooms in them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
ALLOWED = {
    "spcola": {"spcola"},
    "lidar": {"spcola", "lidar"},
    "fusion": {"spcola", "lidar", "fusion"},
}
MODULES = {
    package: [path.relative_to(ROOT) for path in sorted((ROOT / package).rglob("*.py"))]
    for package in ALLOWED
}
MOST_BOXES = 17
MOST_NAMES = 9


def text_of(path: Path) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and module of each import of the three packages, wherever in the file."""
    for node in ast.walk(ast.parse(text_of(path))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield node.lineno, node.module or ""


def dotted(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def box(module: str) -> str:
    """Return the room or file at a package's top to which a module belongs."""
    return ".".join(module.split(".")[:2])


def is_room(module: str) -> bool:
    return (ROOT / module.replace(".", "/") / "__init__.py").is_file()


def offers(module: str) -> bool:
    """Return whether a module states what others may use: a room, or one file with ``__all__``."""
    path = Path(module.replace(".", "/") + ".py")
    return is_room(module) or ((ROOT / path).is_file() and "\n__all__ = " in text_of(path))


def rooms() -> list[str]:
    return [dotted(path) for paths in MODULES.values() for path in paths if offers(dotted(path))]


def test_the_packages_are_there() -> None:
    assert all(MODULES.values())


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_point_to_the_left(package: str) -> None:
    back = [
        f"{path}:{line}: {module}"
        for path in MODULES[package]
        for line, module in imports(path)
        if module.split(".")[0] in set(ALLOWED) - ALLOWED[package]
    ]
    assert not back


def test_other_rooms_are_entered_through_their_door() -> None:
    # A room's __init__, or the __all__ of a room of one file, exports what others may use.
    through_walls = [
        f"{path}:{line}: {module}"
        for paths in MODULES.values()
        for path in paths
        for line, module in imports(path)
        if module.split(".")[0] in ALLOWED and box(module) != box(dotted(path))
        if module.count(".") > 1 and not offers(module)
    ]
    assert not through_walls


@pytest.mark.parametrize("package", ALLOWED)
def test_no_arrow_between_rooms_runs_back(package: str) -> None:
    arrows: dict[str, set[str]] = {}
    for path in MODULES[package]:
        here = box(dotted(path))
        # The package's own __init__ offers what is in its rooms.
        if here == package:
            continue
        there = {box(module) for _, module in imports(path)} - {here, package}
        arrows.setdefault(here, set()).update(m for m in there if m.startswith(f"{package}."))
    assert list(TopologicalSorter(arrows).static_order())
    assert len(arrows) <= MOST_BOXES


def test_rooms_offer_few_names_and_have_them() -> None:
    many = {}
    for room in rooms():
        if room in ALLOWED:
            continue
        door: Any = import_module(room)
        names = getattr(door, "__all__", [])
        assert all(getattr(door, name, None) is not None for name in names), room
        if len(names) > MOST_NAMES:
            many[room] = len(names)
    assert not many


def test_spcola_never_mentions_lidar() -> None:
    saying = [str(path) for path in MODULES["spcola"] if "lidar" in text_of(path).lower()]
    assert not saying


def test_modules_are_short() -> None:
    lengths = {
        str(path): len(text_of(path).splitlines()) for paths in MODULES.values() for path in paths
    }
    assert not {path: length for path, length in lengths.items() if length > 500}
