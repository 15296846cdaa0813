"""Output of commands: one JSON object, or lines of text."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sized
from typing import TYPE_CHECKING, Any

import typer

from fusion.estimation.verdict import verdict_lines
from spcola.errors import SpcolaError

if TYPE_CHECKING:
    from fusion.pipeline import StageRun

MANY_LINES = 25
"""A longer table in a summary is not printed as text, only counted."""

_VERDICT = ("verdict", "findings")


def show(content: Mapping[str, Any], lines: Iterable[str], *, as_json: bool) -> None:
    """Print `content` as JSON, or `lines`.

    Raises
    ------
    SpcolaError
        If standard output cannot be written, as on a full disk.
    """
    # The command has imported these by now.
    from fusion.runtime import json_text

    try:
        text = json_text(content) if as_json else "".join(f"{x}\n" for x in lines)
        typer.echo(text.encode("utf-8", "backslashreplace").decode("utf-8"), nl=False)
        # A full disk would otherwise fail at the end of the interpreter, without a message.
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise SpcolaError(f"cannot be written ({error.strerror})", "standard output") from error


def run_lines(run: StageRun) -> list[str]:
    """Return the lines about one stage: its state, and the single values of its summary."""
    took = f" in {run.seconds:.1f} s" if run.state == "ran" else ""
    why = f": {run.reason}" if run.reason else ""
    shown = {key: value for key, value in run.summary.items() if key not in _VERDICT}
    found = {finding["text"] for finding in run.summary.get("findings") or ()}
    if "reasons" in shown and not [text for text in shown["reasons"] or () if text not in found]:
        del shown["reasons"]
    verdict = [f"  {line}" for line in verdict_lines(run.summary)]
    return [f"{run.stage}: {run.state}{took}{why}", *verdict, *value_lines(shown)]


def value_lines(summary: Mapping[str, Any], indent: str = "  ") -> list[str]:
    """Return a line for each number, word or short list in `summary`; long tables are counted."""
    lines = []
    for key, value in summary.items():
        if isinstance(value, Mapping | list | tuple) and not value:
            lines.append(f"{indent}{key}: none")
        elif isinstance(value, Mapping):
            inner = value_lines(value, indent + "  ")
            short = len(inner) <= MANY_LINES
            lines += [f"{indent}{key}:", *inner] if short else [f"{indent}{key}: {_entries(value)}"]
        elif isinstance(value, list | tuple):
            if value and all(isinstance(item, str) and " " in item for item in value):
                lines += [f"{indent}{key}:", *(f"{indent}  - {item}" for item in value)]
            elif len(value) <= 7 and all(_is_single(item) for item in value):
                lines.append(f"{indent}{key}: {', '.join(_text(item) for item in value)}")
            else:
                lines.append(f"{indent}{key}: {_entries(value)}")
        elif _is_single(value):
            lines.append(f"{indent}{key}: {_text(value)}")
    return lines


def _entries(values: Sized) -> str:
    return f"{len(values)} entr{'y' if len(values) == 1 else 'ies'}"


def _is_single(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float)


def _text(value: Any) -> str:
    """Return a number with six digits; "unknown" for None and NaN."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "unknown"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
