"""Settings: defaults survive the file, and everything wrong is one line with file and key."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from fusion.settings import (
    Settings,
    load_settings,
    parse_settings,
    settings_text,
    table_models,
    write_settings,
)
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
    ("text", "says"),
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
    tmp_path: Path, text: str, says: list[str]
) -> None:
    path = tmp_path / "spcola.toml"
    path.write_text(text)
    with pytest.raises(SettingsError) as caught:
        load_settings(path)
    message = str(caught.value)
    assert "\n" not in message
    for part in [str(path), *says]:
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
