"""Settings of a workspace: one table for each stage, read from ``spcola.toml``."""

from __future__ import annotations

import reprlib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from fusion.workspace.settings.inputs import (
    BodySettings,
    ImportSettings,
    SpiceSettings,
    SpinSettings,
)
from fusion.workspace.settings.processing import (
    AcceptSettings,
    BigmapSettings,
    FuseSettings,
    LithosSettings,
    MapolaSettings,
    RegisterSettings,
    ReleaseSettings,
    ScaleSettings,
)
from fusion.workspace.settings.ranges import range_text
from fusion.workspace.settings.table import Table
from spcola import atomic
from spcola.errors import SettingsError

# A key that is longer is cut in messages.
_NAME_LENGTH = 60
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _NAME_LENGTH


class Settings(BaseModel):
    """All tables. The file's [import] is the attribute ``ingest``: Python reserves the word."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    body: BodySettings = BodySettings()
    ingest: ImportSettings = Field(default=ImportSettings(), alias="import")
    spin: SpinSettings = SpinSettings()
    spice: SpiceSettings = SpiceSettings()
    mapolas: MapolaSettings = MapolaSettings()
    registration: RegisterSettings = Field(default=RegisterSettings(), alias="register")
    fuse: FuseSettings = FuseSettings()
    lithos: LithosSettings = LithosSettings()
    bigmap: BigmapSettings = BigmapSettings()
    scale: ScaleSettings = ScaleSettings()
    release: ReleaseSettings = ReleaseSettings()
    accept: AcceptSettings = AcceptSettings()

    def with_table(self, table: str, **changed: Any) -> Settings:
        """Return the settings with some keys of `table` (its name in the file) replaced.

        Raises
        ------
        SettingsError
            If a key is unknown or a value is not allowed.
        """
        return self.with_tables({table: changed}, "command line")

    def with_tables(self, tables: Mapping[str, Mapping[str, Any]], where: str | Path) -> Settings:
        """Return the settings with some keys of several tables replaced; errors name `where`.

        Raises
        ------
        SettingsError
            If a table or key is unknown or a value is not allowed.
        """
        content = self.model_dump(by_alias=True)
        for table, changed in tables.items():
            content[table] = {**content.get(table, {}), **changed}
        return parse_settings(content, where)


def load_settings(path: str | Path) -> Settings:
    """Read settings from a TOML file; missing keys have their defaults.

    Raises
    ------
    SettingsError
        If the file is not TOML or cannot be read, a key is unknown, or a value has the wrong type
        or lies outside its range.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"is not TOML: {error}", path) from error
    except UnicodeDecodeError as error:
        raise SettingsError("is not UTF-8 text", path) from error
    except (ValueError, RecursionError) as error:
        # A number of more digits than Python converts, or brackets nested too deep.
        raise SettingsError(f"is not TOML that can be read: {error}", path) from error
    except OSError as error:
        raise SettingsError(f"cannot be read ({error.strerror})", path) from error
    return parse_settings(content, path)


def parse_settings(content: dict[str, Any], where: str | Path) -> Settings:
    """Check `content` (nested, as read from TOML); `where` is named in errors.

    Raises
    ------
    SettingsError
        If a key is unknown, or a value has the wrong type or lies outside its range.
    """
    try:
        return Settings.model_validate(content)
    except ValidationError as error:
        raise _refusal(error.errors(include_url=False)[0], where) from error


def _refusal(problem: ErrorDetails, where: str | Path) -> SettingsError:
    """Turn the first error of pydantic into one line."""
    location = [str(part)[:_NAME_LENGTH] for part in problem["loc"]]
    place = f"{where}: [{location[0]}]" + "".join(f" {part}" for part in location[1:])
    if problem["type"] != "extra_forbidden":
        return SettingsError(problem_text(problem), place)
    if len(location) == 1:
        known = ", ".join(f"[{name}]" for name in table_models())
        return SettingsError("is an unknown table", place, f"known are {known}")
    names = ", ".join(table_models()[location[0]].model_fields)
    return SettingsError("is an unknown key", place, f"known are {names}")


def problem_text(problem: ErrorDetails) -> str:
    """Return pydantic's error about a value as one clause."""
    known = {
        "missing": "is missing",
        "unexpected_keyword_argument": "is an unknown entry",
        "model_type": "should be a table",
        "dataclass_type": "should be a table",
    }
    if problem["type"] in known:
        return known[problem["type"]]
    text = problem["msg"]
    for prefix in ("Input ", "String ", "Value error, "):
        text = text.removeprefix(prefix)
    # An error that concerns several keys is not clearer with the whole table printed.
    given = problem["input"]
    return text if isinstance(given, dict) else f"{text}, not {_SHORT.repr(given)}"


def table_models() -> dict[str, type[Table]]:
    """Return the model of each table, by its name in the file, in the file's order."""
    models: dict[str, type[Table]] = {}
    for name, info in Settings.model_fields.items():
        model = info.annotation
        assert isinstance(model, type)
        assert issubclass(model, Table)
        models[info.alias or name] = model
    return models


def settings_text(settings: Settings) -> str:
    """Return `settings` as TOML, every key with a comment on its meaning."""
    lines = [
        "# Settings of this SPCOLA workspace: one table for each stage.",
        "# Units are in the names of keys (_m, _deg, _s). Unknown keys are refused.",
    ]
    content = settings.model_dump(by_alias=True)
    for table, model in table_models().items():
        lines += ["", f"[{table}]"]
        for key, info in model.model_fields.items():
            numbers = range_text(info.annotation, info.metadata)
            about = f"{info.description}{_choices(info.annotation)}{numbers}"
            lines.append(f"{key} = {_toml(content[table][key])}  # {about}")
    return "\n".join(lines) + "\n"


def write_settings(path: str | Path, settings: Settings) -> None:
    """Write `settings` with their comments to `path`, whole or not at all."""
    atomic.write_text(path, settings_text(settings))


def _choices(annotation: Any) -> str:
    """Return the allowed words of a key for its comment; empty if it takes other values."""
    if get_origin(annotation) is not Literal:
        return ""
    return f" ({' | '.join(map(str, get_args(annotation)))})"


def _toml(value: Any) -> str:
    """Return a TOML literal of a string, number, boolean, or list or table of them."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c >= " " else f"\\u{ord(c):04x}" for c in escaped) + '"'
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)
