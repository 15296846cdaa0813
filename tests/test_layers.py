"""The order of the packages: spcola ← lidar ← fusion, and nothing back."""

from __future__ import annotations

import ast
from pathlib import Path

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


def text_of(path: Path) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def imported_packages(path: Path) -> set[str]:
    """Return the top-level names that a module imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(text_of(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            names.add((node.module or "").split(".")[0])
    return names


def test_the_packages_are_there() -> None:
    assert all(MODULES.values())


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_point_to_the_left(package: str) -> None:
    back = {
        str(path): sorted(names)
        for path in MODULES[package]
        if (names := imported_packages(path) & set(ALLOWED) - ALLOWED[package])
    }
    assert not back


def test_spcola_never_says_lidar() -> None:
    saying = [str(path) for path in MODULES["spcola"] if "lidar" in text_of(path).lower()]
    assert not saying


@pytest.mark.parametrize("package", ALLOWED)
def test_modules_are_short(package: str) -> None:
    lengths = {str(path): len(text_of(path).splitlines()) for path in MODULES[package]}
    assert not {path: length for path, length in lengths.items() if length > 500}
