"""Absurd numbers on the command line: every option that takes a number, of every command."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import pytest
import typer
from command_line import app
from typer.testing import CliRunner

from fusion.workspace import Workspace
from fusion.workspace.settings import Settings

ABSURD = ("nan", "inf", "-inf", "-1", "0", "1e308", "1e-308", str(10**30), "9" * 5000)
SENSIBLE = {
    # A free port; workers that run on other hosts only.
    "serve start --port": {"0"},
    "serve start --workers": {"0"},
    "--smear-s": {"0", "1e-308"},
    "--gsd": {"0"},  # left to the program
    "--seed": {"0"},
    "--psf": {"0", "1e-308"},
    "--overlap": {"0", "1e-308"},
    "--albedo-range": {"0", "1e-308"},
    "--slope-error": {"0", "1e-308"},
    "--faces-from": {"0"},
    "--first-pixel": {"0", "1e-308"},
    "--clearing-s": {"0", "1e-308"},
    "--low": {"0"},
    # NAIF numbers, temperatures, directions: of either sign.
    **{
        name: {"-1", "0", "1e-308"}
        for name in (
            "--number",
            "--variant",
            "--body",
            "--camera",
            "--temperature",
            "--motor",
            "--optical-axis",
            "--pupil-m",
        )
    },
}


def commands(
    group: typer.Typer, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    for one in group.registered_commands:
        assert one.name is not None
        yield (*path, one.name), one.callback
    for inner in group.registered_groups:
        assert inner.typer_instance is not None
        yield from commands(inner.typer_instance, (*path, str(inner.typer_instance.info.name)))


def parts(annotation: Any) -> tuple[Any, ...]:
    """The types that a value may have: those of a union, and of the items of a list."""
    inner = get_args(annotation)
    return tuple(kind for one in inner for kind in parts(one)) if inner else (annotation,)


def parameters(command: Any) -> Iterator[tuple[inspect.Parameter, Any, tuple[Any, ...]]]:
    """Parameters of a command, what Typer knows of them, and their types."""
    hints = get_type_hints(command, include_extras=True)
    for parameter in inspect.signature(command).parameters.values():
        hint = hints[parameter.name]
        assert get_origin(hint) is Annotated, f"{parameter.name} is no Typer parameter"
        kind, *info = get_args(hint)
        yield parameter, info[0], parts(kind)


def name_of(parameter: inspect.Parameter, info: Any) -> str:
    """The option's long name; in Annotated the first name stands where the default would."""
    stated = [one for one in (info.default, *(info.param_decls or ())) if isinstance(one, str)]
    names = [name for name in stated if name.startswith("--")]
    return (names or ["--" + parameter.name.replace("_", "-")])[0]


def number_of_values(command: Any, option: str) -> int:
    """How many values an option takes."""
    for parameter, info, kinds in parameters(command):
        if isinstance(info, typer.models.OptionInfo) and name_of(parameter, info) == option:
            text = str(get_type_hints(command)[parameter.name])
            return len([kind for kind in kinds if kind is not type(None)]) if "tuple" in text else 1
    raise AssertionError(option)


def numeric() -> Iterator[tuple[tuple[str, ...], str]]:
    for path, command in commands(app):
        for parameter, info, kinds in parameters(command):
            if {int, float} & set(kinds):
                assert isinstance(info, typer.models.OptionInfo), "no argument is a number so far"
                yield path, name_of(parameter, info)


OPTIONS = sorted(numeric())


def content(folder: Path) -> dict[str, Any]:
    return {
        str(path.relative_to(folder)): path.is_file() and path.read_bytes()
        for path in folder.rglob("*")
    }


def required(command: Any, workspace: Path) -> list[str]:
    """Arguments that a command needs: the workspace for every path and name, 1 for numbers."""
    given = []
    for parameter, info, kinds in parameters(command):
        if parameter.default is inspect.Parameter.empty:
            assert {Path, str, float} & set(kinds), f"state what {parameter.name} may be here"
            option = isinstance(info, typer.models.OptionInfo)
            given += [
                *(["--" + parameter.name.replace("_", "-")] if option else []),
                "1" if float in kinds else str(workspace),
            ]
    return given


def test_all_commands_are_walked() -> None:
    assert {path for path, _ in commands(app)} >= {("run",), ("import",), ("truth", "assess")}
    assert len(OPTIONS) > 20
    assert {name for _, name in OPTIONS} >= {"--workers", "--gsd", "--limit-s", "--seed"}


@pytest.mark.parametrize(
    ("path", "option"), OPTIONS, ids=lambda x: x if isinstance(x, str) else "_".join(x)
)
def test_an_absurd_number_is_refused_by_the_name_of_its_option(
    path: tuple[str, ...], option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    workspace = Workspace.create(tmp_path / "ws", Settings()).root
    before = content(tmp_path)
    command = dict(commands(app))[path]
    sensible = SENSIBLE.get(option, set()) | SENSIBLE.get(" ".join((*path, option)), set())
    for value in ABSURD:
        if value in sensible:
            continue
        many = number_of_values(command, option)
        values = [f"{option}={value}"] if many == 1 else [option, *([value] * many)]
        arguments = [*path, *required(command, workspace), *values]
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2, (value, result.output)
        assert result.stdout == ""
        line = result.stderr.splitlines()[-1]
        assert line.startswith("Error: Invalid value for"), line
        assert option in line
        assert len(line) < 6000
        assert "unexpected" not in result.output
        assert "Traceback" not in result.output
        assert content(tmp_path) == before, value
