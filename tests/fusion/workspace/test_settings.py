"""Settings: defaults survive the file, and everything wrong is one line with file and key."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from fusion.workspace.settings import Settings, load_settings, write_settings
from fusion.workspace.settings.ranges import Span
from fusion.workspace.settings.settings import parse_settings, settings_text, table_models
from spcola.errors import SettingsError


def test_written_defaults_are_read_back_equal(tmp_path: Path) -> None:
    write_settings(tmp_path / "spcola.toml", Settings())
    assert load_settings(tmp_path / "spcola.toml") == Settings()


def test_changed_values_survive_the_file(tmp_path: Path) -> None:
    settings = (
        Settings()
        .with_table("body", name='a "quoted" \\ name', shape="line\nfeed")
        .with_table("scale", method="shots", size_m=12.5)
        .with_table("release", products=["map", "ply"])
    )
    write_settings(tmp_path / "spcola.toml", settings)
    assert load_settings(tmp_path / "spcola.toml") == settings


def test_an_empty_file_means_defaults(tmp_path: Path) -> None:
    (tmp_path / "spcola.toml").write_text("")
    assert load_settings(tmp_path / "spcola.toml") == Settings()


def test_every_key_is_written_with_a_comment() -> None:
    lines = settings_text(Settings()).splitlines()
    for model in table_models().values():
        for key, info in model.model_fields.items():
            assert info.description
            assert any(line.startswith(f"{key} = ") and "  # " in line for line in lines), key


def test_every_table_of_the_file_has_a_model() -> None:
    assert set(tomllib.loads(settings_text(Settings()))) == set(table_models())


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[nonsense]\n", ["[nonsense]", "unknown table", "[mapolas]"]),
        ("[mapolas]\ngsd = 1\n", ["[mapolas] gsd", "unknown key", "gsd_m", "half_size"]),
        ('[mapolas]\ngsd_m = "1"\n', ["[mapolas] gsd_m", "number", "'1'"]),
        ("[mapolas]\ngsd_m = -1\n", ["[mapolas] gsd_m", "-1"]),
        ("[mapolas]\ngsd_m = nan\n", ["[mapolas] gsd_m", "finite"]),
        ("[mapolas]\nmin_count = 1.5\n", ["[mapolas] min_count", "1.5"]),
        ("[mapolas]\nmin_count = true\n", ["[mapolas] min_count", "integer"]),
        ('[scale]\nmethod = "guess"\n', ["[scale] method", "'pairs' or 'shots'", "'guess'"]),
        ('[release]\nproducts = ["pdf"]\n', ["[release] products", "'pdf'"]),
        ("mapolas = 3\n", ["[mapolas]", "table"]),
        ("[mapolas\n", ["not TOML", "line 1"]),
    ],
)
def test_what_is_wrong_is_named_with_file_and_key(
    tmp_path: Path, text: str, parts: list[str]
) -> None:
    path = tmp_path / "spcola.toml"
    path.write_text(text)
    with pytest.raises(SettingsError) as caught:
        load_settings(path)
    message = str(caught.value)
    assert "\n" not in message
    for part in [str(path), *parts]:
        assert part in message


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "spcola.toml").write_bytes(b"[body]\nname = '\xff'\n")
    with pytest.raises(SettingsError, match="UTF-8"):
        load_settings(tmp_path / "spcola.toml")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="cannot be read"):
        load_settings(tmp_path / "spcola.toml")


def test_whole_numbers_serve_as_real_ones() -> None:
    assert parse_settings({"scale": {"size_m": 50}}, "x").scale.size_m == 50.0


def test_options_of_the_command_line_are_checked_like_the_file() -> None:
    with pytest.raises(SettingsError, match=r"command line: \[mapolas\] gsd_m"):
        Settings().with_table("mapolas", gsd_m=-1.0)


def numbers_of(annotation: Any, metadata: tuple[Any, ...] | list[Any]) -> Iterator[list[Span]]:
    """The ranges of every number that a setting of this type holds, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for info in annotation.model_fields.values():
            yield from numbers_of(info.annotation, info.metadata)
    elif annotation in (int, float):
        yield [one for one in metadata if isinstance(one, Span)]
    for part in getattr(annotation, "__args__", ()):
        inner = getattr(part, "__metadata__", ())
        yield from numbers_of(part.__origin__ if inner else part, inner)


FIELDS = [
    (table, key, info)
    for table, model in table_models().items()
    for key, info in model.model_fields.items()
]


def test_every_number_has_a_range_in_its_comment() -> None:
    wrong = []
    for table, key, info in FIELDS:
        comment = next(
            line.partition("  # ")[2]
            for line in settings_text(Settings()).partition(f"\n[{table}]\n")[2].splitlines()
            if line.startswith(f"{key} = ")
        )
        for spans in numbers_of(info.annotation, info.metadata):
            if len(spans) != 1:
                wrong.append(f"[{table}] {key}: a number without a range")
            elif not (math.isfinite(spans[0].low) and spans[0].low < spans[0].high < 1e11):
                wrong.append(f"[{table}] {key}: {spans[0]} is no range")
            # Numbers of the sites are in a table of their own.
            elif (table, key) != ("bigmap", "sites") and not comment.endswith(f"({spans[0]})"):
                wrong.append(f"[{table}] {key}: its comment lacks {spans[0]}")
    assert not wrong


ABSURD = [
    *(0, -1, 1e-300, 1e-9, 1e9, 1e308, 2**63, 10**400, -(2**63), 0.5, math.inf, math.nan),
    *("", "x" * 100_000, "\0", "no such word", "../../etc/passwd"),
    *([], [0.0], [1e308] * 3, ["x"] * 100_000, [[]], [1e9] * 2, {}, {"x": 1}, True, None),
]


def fault_of(table: str, key: str, info: Any, value: object) -> str:
    """What is wrong with how a setting takes an absurd value; nothing if it is refused or used."""
    try:
        settings = parse_settings({table: {key: value}}, "spcola.toml")
    except SettingsError as error:
        message = str(error)
        named = message.startswith(f"spcola.toml: [{table}]") and "\n" not in message
        return "" if named and len(message) < 1500 else f"is refused by {message[:2000]!r}"
    kept = settings.model_dump(by_alias=True)[table][key]
    spans = [one for found in numbers_of(info.annotation, info.metadata) for one in found]
    for number in kept if isinstance(kept, list) else [kept]:
        if isinstance(number, int | float) and not isinstance(number, bool):
            within = spans[0].holds(number) if spans else number in get_args(info.annotation)
            if not within:
                return f"takes {number}"
    return "" if len(str(kept)) < 5000 else "keeps thousands of characters"


def test_absurd_values_are_refused_in_one_short_line_or_within_range() -> None:
    wrong = {
        f"[{table}] {key} = {str(value)[:60]}": fault
        for table, key, info in FIELDS
        for value in ABSURD
        if (fault := fault_of(table, key, info, value))
    }
    assert not wrong


def test_a_pole_shifted_past_the_pole_is_refused() -> None:
    table = {"pole_dec_deg": 80.0, "shift_pole_dec_deg": 10.5}
    with pytest.raises(
        SettingsError, match=r"\[spin\]: pole_dec_deg and shift_pole_dec_deg"
    ) as caught:
        parse_settings({"spin": table}, "spcola.toml")
    assert "{" not in str(caught.value)
    assert parse_settings({"spin": {**table, "shift_pole_dec_deg": 10.0}}, "x").spin


def test_a_long_key_is_cut_in_the_message() -> None:
    with pytest.raises(SettingsError) as caught:
        parse_settings({"mapolas": {"x" * 100_000: 1}}, "spcola.toml")
    assert len(str(caught.value)) < 1000
