"""Settings of the service: ``.service/settings.toml`` in its folder."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from fusion.runtime.processes import ProcessLimits
from fusion.service.api import Limits
from spcola.errors import InvalidValueError, SettingsError

SETTINGS_NAME = "settings.toml"
Table = TypeVar("Table", bound=Any)


@dataclass(frozen=True)
class Ages:
    """After how many days something is removed; ``inf`` for never.

    Parameters
    ----------
    jobs_days : float
        Since a job ended: the job, its result and its log.
    events_days : float
        Log and progress of jobs that have ended.
    audit_days : float
        Entries of the audit log.
    uploads_days : float
        Uploads to which nothing was added, and complete ones that no job waits for.
    outputs_days : float
        Outputs of jobs since they were written, but for those that a job waits for.
    logs_days : float
        Files in ``.service/logs`` that nobody writes to any more.
    """

    jobs_days: float = 365.0
    events_days: float = 90.0
    audit_days: float = 730.0
    uploads_days: float = 14.0
    outputs_days: float = 365.0
    logs_days: float = 90.0

    def __post_init__(self) -> None:
        # An idle worker writes a line a day: the file of one that runs is never two days old.
        if self.logs_days < 2.0:
            raise InvalidValueError("should be 2 or more", "logs_days")


@dataclass(frozen=True)
class ServiceSettings:
    """All tables of the file.

    Parameters
    ----------
    limits : Limits
        Of users and requests.
    parsers : ProcessLimits
        Of the processes that read a user's file, for each file.
    keep : Ages
    """

    limits: Limits = field(default_factory=Limits)
    parsers: ProcessLimits = field(default_factory=ProcessLimits)
    keep: Ages = field(default_factory=Ages)


def read_settings(path: Path) -> ServiceSettings:
    """Read settings; what the file does not give has its default, also if there is no file.

    Raises
    ------
    SettingsError
        If the file is not TOML, a table or key is unknown, or a value is not allowed.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"is not TOML: {error}", path) from error
    except OSError as error:
        raise SettingsError(f"cannot be read ({error.strerror})", path) from error
    defaults = ServiceSettings()
    known = [one.name for one in fields(ServiceSettings)]
    _check_known(content, known, str(path))
    tables = {
        name: _table(getattr(defaults, name), content.get(name, {}), f"{path}: [{name}]")
        for name in known
    }
    return ServiceSettings(**tables)


def settings_text(settings: ServiceSettings) -> str:
    """Return the file with these settings."""
    lines = []
    for table in fields(settings):
        lines.append(f"[{table.name}]")
        values = getattr(settings, table.name)
        lines += [f"{one.name} = {getattr(values, one.name)!r}" for one in fields(values)]
        lines.append("")
    return "\n".join(lines)


def _table(default: Table, given: Any, where: str) -> Table:
    """Return a table with the given values in place of the default ones."""
    if not isinstance(given, Mapping):
        raise SettingsError("should be a table", where)
    _check_known(given, [one.name for one in fields(default)], where)
    for name, value in given.items():
        wanted = type(getattr(default, name))
        allowed = (int,) if wanted is int else (int, float)
        if isinstance(value, bool) or not isinstance(value, allowed):
            kind = "a whole number" if wanted is int else "a number"
            raise SettingsError(f"should be {kind}, not {str(value)[:60]!r}", f"{where} {name}")
        if math.isnan(value) or value <= 0:
            raise SettingsError(f"should be positive, not {value!r}", f"{where} {name}")
    kept = {one.name: getattr(default, one.name) for one in fields(default)}
    try:
        return type(default)(**{**kept, **given})
    except InvalidValueError as error:
        raise SettingsError(error.what, f"{where} {error.where}") from error


def _check_known(given: Mapping[str, Any], known: list[str], where: str) -> None:
    unknown = next((name for name in given if name not in known), None)
    if unknown is not None:
        what = f"has the unknown entry {unknown[:60]!r}"
        raise SettingsError(what, where, f"known are {', '.join(known)}")
