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
MODULES = [
    pytest.param(package, path, id=str(path.relative_to(ROOT)))
    for package in ALLOWED
    for path in sorted((ROOT / package).rglob("*.py"))
]


def imported_packages(path: Path) -> set[str]:
    """Return the top-level names that a module imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            names.add((node.module or "").split(".")[0])
    return names


def test_the_packages_are_there() -> None:
    assert {parameter.values[0] for parameter in MODULES} == set(ALLOWED)


@pytest.mark.parametrize(("package", "path"), MODULES)
def test_imports_point_to_the_left(package: str, path: Path) -> None:
    assert imported_packages(path) & set(ALLOWED) <= ALLOWED[package]


@pytest.mark.parametrize("path", [p.values[1] for p in MODULES if p.values[0] == "spcola"])
def test_spcola_never_says_lidar(path: Path) -> None:
    assert "lidar" not in path.read_text(encoding="utf-8").lower()


@pytest.mark.parametrize(("package", "path"), MODULES)
def test_modules_are_short(package: str, path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 500
