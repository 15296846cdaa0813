"""How every command ends: what is printed on an error, and with which exit code."""

from __future__ import annotations

import functools
import os
import traceback
from collections.abc import Callable
from typing import ParamSpec

import typer

from spcola.errors import SpcolaError

FAILED = 1
INTERRUPTED = 130
DEBUG_VARIABLE = "SPCOLA_DEBUG"
Options = ParamSpec("Options")


def guarded(command: Callable[Options, None]) -> Callable[Options, None]:
    """Make an error of `command` one line on standard error and exit code 1.

    Wrong usage (exit code 2) is told by Typer, here and before the command begins.
    """

    @functools.wraps(command)
    def guard(*args: Options.args, **kwargs: Options.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except (typer.Exit, typer.BadParameter, BrokenPipeError):
            raise
        except SpcolaError as error:
            _tell(f"error: {error}", error)
            raise typer.Exit(FAILED) from error
        except KeyboardInterrupt as error:
            _tell("interrupted: what was finished is kept, and the command can be given again")
            raise typer.Exit(INTERRUPTED) from error
        except MemoryError as error:
            what = " ".join(str(error).split()) or "no more to be had"
            _tell(
                f"error: out of memory ({what}); take fewer --workers, a smaller [import] chunk, "
                "coarser or smaller grids, and check units",
                error,
            )
            raise typer.Exit(FAILED) from error
        except Exception as error:  # whatever it is, the user gets one line and a way to more
            what = " ".join(str(error).split()) or "no message"
            _tell(
                f"error: unexpected {type(error).__name__}: {what}; "
                f"set {DEBUG_VARIABLE}=1 to see where, and please report it",
                error,
            )
            raise typer.Exit(FAILED) from error

    return guard


def _tell(line: str, error: BaseException | None = None) -> None:
    """Print one line to standard error; before it the traceback, if the user asked for it."""
    if error is not None and os.environ.get(DEBUG_VARIABLE, "") not in ("", "0"):
        typer.echo("".join(traceback.format_exception(error)), err=True, nl=False)
    typer.echo(line, err=True)
