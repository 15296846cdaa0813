"""Settings at the limits of their ranges, on a small mission: nothing may end as "unexpected".

Each number of spcola.toml is set to the least and the largest value that it takes, one at a time,
in a copy of a finished workspace, and the stage of that table is run (for [import], [spin] and
[spice] that of the mapolas). Printed for each: the outcome (ran, or refused with its line), and the
seconds; "UNEXPECTED", and exit 1, for any other error, and for a run longer than --limit.

    python scripts/bench/absurd.py WS [--only TABLE[.KEY]] [--limit 120]
"""

from __future__ import annotations

import argparse
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fusion.pipeline import Pipeline
from fusion.runtime import Progress, ThreadExecutor
from fusion.stages import load_stages
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.ranges import Span
from fusion.workspace.settings.settings import parse_settings, table_models
from spcola.errors import SpcolaError

STAGES = {"import": "ingest", "spin": "mapolas", "spice": "mapolas", "body": "mapolas"}
MEMORY = 8 << 30


def values_of(info: Any) -> Iterator[Any]:
    """Yield the limits of a number's range; for a list, lists of them."""
    for one in info.metadata:
        if isinstance(one, Span):
            whole = isinstance(info.default, int) and not isinstance(info.default, bool)
            yield from ((int if whole else float)(end) for end in (one.low, one.high))
    for part in getattr(info.annotation, "__args__", ()):
        for one in getattr(part, "__metadata__", ()):
            if isinstance(one, Span):
                yield from ([end] * len(info.default) for end in (one.low, one.high))


def cases() -> Iterator[tuple[str, str, Any]]:
    for table, model in table_models().items():
        for key, info in model.model_fields.items():
            for value in values_of(info):
                yield table, key, value
    site = {"name": "A", "latitude_deg": 0.0}
    for changed in ({"size_m": 1e8}, {"size_m": 1e-3}, {"gsd_m": 1e5}, {"gsd_m": 1e-4}):
        yield "bigmap", "sites", [{**site, **changed}]
    for key, word in (("shape", "no such"), ("photometry", "none such"), ("apply", "x" * 999)):
        yield {"shape": "body", "photometry": "register", "apply": "register"}[key], key, word


def outcome(root: Path, settings: Settings, stage: str) -> str:
    """Run a stage and return its outcome."""
    pipeline = Pipeline(
        Workspace.open(root),
        settings,
        load_stages(),
        ThreadExecutor(1),
        Progress.fitting(silent=True),
    )
    try:
        run = pipeline.run_stage(stage, force=True)
    except SpcolaError as error:
        return f"refused: {error}"
    except OSError as error:
        if error.filename is None:
            raise
        return f"refused: {error.filename!s:.60}: {error.strerror}"
    except MemoryError as error:
        return f"no memory: {error}"
    return run.state


def too_long(*_: object) -> None:
    raise TimeoutError


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("workspace", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--limit", type=int, default=120, help="seconds")
    given = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGALRM, too_long)
    failed = 0
    for table, key, value in cases():
        if not f"{table}.{key}".startswith(given.only):
            continue
        with tempfile.TemporaryDirectory() as temporary:
            root = Path(shutil.copytree(given.workspace, Path(temporary) / "ws", symlinks=True))
            content = Workspace.open(root).settings().model_dump(by_alias=True)
            content[table][key] = value
            begun = time.monotonic()
            signal.alarm(given.limit)
            try:
                settings = parse_settings(content, "spcola.toml")
                found = outcome(root, settings, STAGES.get(table, table))
            except SpcolaError as error:
                found = f"refused: {error}"
            except Exception as error:
                found = f"UNEXPECTED {type(error).__name__}: {error}"
                failed += 1
            signal.alarm(0)
        print(
            f"{table}.{key} = {value!r:.60}: {time.monotonic() - begun:.1f} s, {found}", flush=True
        )
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
