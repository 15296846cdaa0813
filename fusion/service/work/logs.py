"""Structured log of the service's processes: JSON lines on standard error and in a file."""

from __future__ import annotations

import logging
import logging.handlers
import os
import sys
from pathlib import Path
from typing import Any

import structlog

from fusion.runtime.folders import make_folder
from spcola.errors import SettingsError

_LARGEST = 20_000_000
_KEPT = 5
LEVEL_VARIABLE = "SPCOLA_LOG_LEVEL"
_LEVELS = ("debug", "info", "warning", "error")

# Before `start_log`, as in a program of a user, what is no warning is not printed.
log: Any = structlog.wrap_logger(
    logging.getLogger("spcola.service"), wrapper_class=structlog.stdlib.BoundLogger
)


def start_log(folder: Path | None, name: str) -> None:
    """Write all log records of this process as JSON lines to standard error, and to a file.

    Parameters
    ----------
    folder : Path, optional
        Where the file ``NAME.jsonl`` goes; up to five older ones of 20 MB are kept.
    name : str
        Of the process: each has a file of its own.

    Raises
    ------
    SettingsError
        If the variable SPCOLA_LOG_LEVEL is no level.
    """
    level = os.environ.get(LEVEL_VARIABLE, "info")
    if level not in _LEVELS:
        raise SettingsError(f"{level!r} is none of {', '.join(_LEVELS)}", LEVEL_VARIABLE)
    # A full disk must not fill the terminal with traces of the log itself.
    logging.raiseExceptions = False
    common: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.ExtraAdder(),
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    last: list[Any] = [
        structlog.stdlib.ProcessorFormatter.remove_processors_meta,
        # Without local variables, which may be secrets.
        structlog.processors.ExceptionRenderer(
            structlog.tracebacks.ExceptionDictTransformer(show_locals=False)
        ),
        structlog.processors.JSONRenderer(),
    ]
    form = structlog.stdlib.ProcessorFormatter(foreign_pre_chain=common, processors=last)
    handlers: list[logging.Handler] = [logging.StreamHandler(sys.stderr)]
    if folder is not None:
        make_folder(folder)
        path = folder / f"{name}.jsonl"
        handlers.append(
            logging.handlers.RotatingFileHandler(
                path, maxBytes=_LARGEST, backupCount=_KEPT, encoding="utf-8"
            )
        )
    for handler in handlers:
        handler.setFormatter(form)
    logging.basicConfig(level=logging.INFO, handlers=handlers, force=True)
    # Of this program only: libraries have details of their own in plenty.
    logging.getLogger("spcola").setLevel(level.upper())
    structlog.configure(
        processors=[*common, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )
    structlog.contextvars.bind_contextvars(process=name)
