"""Errors of commands: one printed line, and the exit code."""

from __future__ import annotations

import functools
import os
import traceback
from collections.abc import Callable
from typing import ParamSpec

import typer

from fusion.runtime.processes import INTERRUPTED, remembering_interrupts
from spcola.errors import SpcolaError

FAILED = 1
DEBUG_VARIABLE = "SPCOLA_DEBUG"
Options = ParamSpec("Options")
_chosen = {"server": ""}
_INTERRUPTED = "interrupted: what is finished is kept; give the command again to continue"


def choose_server(url: str) -> None:
    """Let the command that follows be done on the server at `url`; here if it is empty."""
    _chosen["server"] = url


def guarded(command: Callable[Options, None]) -> Callable[Options, None]:
    """Turn an error of `command` into one line on standard error and exit code 1.

    Typer reports wrong usage (exit code 2), also before the command begins.
    """

    @functools.wraps(command)
    def guard(*args: Options.args, **kwargs: Options.kwargs) -> None:
        try:
            with remembering_interrupts():
                if _chosen["server"]:
                    from fusion.cli.remote import do_remotely

                    do_remotely(_chosen["server"], command, kwargs)
                else:
                    command(*args, **kwargs)
        except (typer.Exit, typer.BadParameter, BrokenPipeError):
            raise
        except KeyboardInterrupt as error:
            _print(str(error) or _INTERRUPTED)
            raise typer.Exit(INTERRUPTED) from error
        except Exception as error:
            _print(_line_of(error), error)
            raise typer.Exit(FAILED) from error

    return guard


def _line_of(error: Exception) -> str:
    """Return one line about an error; for an unexpected one, also how to learn more."""
    text = " ".join(str(error).split()) or "no message"
    if isinstance(error, SpcolaError):
        return f"error: {text}"
    if isinstance(error, MemoryError):
        return (
            f"error: out of memory ({text}); take fewer --workers, a smaller [import] chunk, "
            "coarser or smaller grids, and check units"
        )
    if isinstance(error, OSError) and isinstance(error.filename, str):
        return f"error: {error.filename}: cannot be used ({error.strerror}); check its permissions"
    return (
        f"error: unexpected {type(error).__name__}: {text}; "
        f"set {DEBUG_VARIABLE}=1 to see where, and please report it"
    )


def _print(line: str, error: BaseException | None = None) -> None:
    """Print one line to standard error, after the traceback if the user set the variable."""
    if error is not None and os.environ.get(DEBUG_VARIABLE, "") not in ("", "0"):
        typer.echo("".join(traceback.format_exception(error)), err=True, nl=False)
    typer.echo(line, err=True)
