"""Forecast of every stage against its run, and the remaining time shown at a tenth of its work.

Makes a mission of a preset, forecasts each stage as the workspace is before anything ran and again
right before the stage runs, then runs it. Printed for each stage: seconds forecast and taken, their
ratio (limit: a factor of 2), disk forecast and taken, and for each part of it that takes over two
seconds the time left that was shown after a tenth of its items and the time that it then took
(limit: a factor of 1.5). Then the registration by returns and by images, and the scale by single
shots, in the same way.

    python scripts/bench/forecast.py [--presets tiny mini] [--seed 1] [--work DIR]
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fusion.inspection.forecasts import StageForecast, stage_forecasts
from fusion.pipeline import Pipeline
from fusion.runtime import Progress, ThreadExecutor
from fusion.runtime.progress import Task
from fusion.stages import import_scans, load_stages
from fusion.truth import PRESETS, make_mission
from fusion.workspace import Workspace, new_workspace
from fusion.workspace.settings import Settings

FACTOR, FACTOR_LEFT, SHORTEST_S = 2.0, 1.5, 2.0
# Other ways of a stage: stage, table, values.
OTHER_WAYS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("register", "register", {"by": "returns"}),
    ("scale", "scale", {"method": "shots"}),
    ("register", "register", {"by": "images"}),
)


class Watching(Progress):
    """Notes what was shown after a tenth of the items of each task, and when the task ended."""

    def __init__(self) -> None:
        super().__init__("silent")
        self.shown: list[tuple[str, float, float]] = []

    @contextmanager
    def items(self, title: str, sizes: Sequence[float], workers: int) -> Iterator[Task]:
        noted: list[tuple[float, float]] = []
        with super().items(title, sizes, workers) as task:
            advance = task.advance_one

            def watched(seconds: float) -> None:
                advance(seconds)
                assert task.remaining is not None
                left = task.remaining.seconds
                tenth = sum(sizes[: task.done]) >= 0.1 * sum(sizes)
                if not noted and tenth and not math.isnan(left) and task.done < len(sizes):
                    noted.append((time.monotonic(), left))

            task.advance_one = watched  # type: ignore[method-assign]
            yield task
        if noted and task.elapsed >= SHORTEST_S:
            self.shown.append((title, noted[0][1], time.monotonic() - noted[0][0]))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--presets", nargs="+", default=["tiny", "mini"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=Path)
    options = parser.parse_args()
    for preset in options.presets:
        with tempfile.TemporaryDirectory() as folder:
            bench(options.work or Path(folder), preset, options.seed)


def bench(work: Path, preset: str, seed: int) -> None:
    """Forecast and run all stages of one mission."""
    mission = work / preset
    make_mission(mission, settings=PRESETS[preset](seed))
    workspace = new_workspace(work / f"{preset}-ws", body="Truth", spc=mission / "spc")
    import_scans(workspace, sorted((mission / "lidar").iterdir()))
    settings, stages = workspace.settings(), load_stages()
    others = [
        stage_forecasts(workspace, settings.with_table(table, **values), only=name)[name]
        for name, table, values in OTHER_WAYS
    ]
    begun = time.monotonic()
    before = stage_forecasts(workspace, settings)
    print(f"{preset}: forecast of the whole run in {time.monotonic() - begun:.1f} s")
    print(
        f"  {'stage':10}{'before, s':>10}{'now, s':>8}{'taken, s':>9}{'ratios':>13}{'':5}disk, MB"
    )
    total = 0.0
    for stage in stages:
        total += forecast_and_run(workspace, settings, stage.name, before[stage.name])
    whole = sum(one.seconds for one in before.values())
    print(f"  {'all':10}{whole:10.1f}{'':8}{total:9.1f}{verdict(whole, total, FACTOR)}")
    for (name, table, values), first in zip(OTHER_WAYS, others, strict=True):
        print(f"  {', '.join(map(str, values.values()))}:")
        forecast_and_run(workspace, settings.with_table(table, **values), name, first)


def forecast_and_run(
    workspace: Workspace, settings: Settings, stage: str, first: StageForecast
) -> float:
    """Forecast a stage as the workspace is now, run it, print both; return the seconds it took."""
    now = stage_forecasts(workspace, settings, only=stage)[stage]
    watch, free, begun = Watching(), size_of(workspace), time.monotonic()
    Pipeline(workspace, settings, load_stages(), ThreadExecutor(), watch).run_stage(stage)
    took = time.monotonic() - begun
    print(
        f"  {stage:10}{first.seconds:10.1f}{now.seconds:8.1f}{took:9.1f}"
        f"{verdict(first.seconds, took, FACTOR)}{verdict(now.seconds, took, FACTOR)}    "
        f"{first.disk_bytes / 1e6:.1f} forecast, {(size_of(workspace) - free) / 1e6:.1f} taken; "
        f"{first.basis}, {now.basis}", flush=True,
    )  # fmt: skip
    for title, left, actual in watch.shown:
        print(f"    {title}: {left:.1f} s left, {actual:.1f} taken"
              f"{verdict(left, actual, FACTOR_LEFT)}")  # fmt: skip
    return took


def verdict(forecast: float, taken: float, factor: float) -> str:
    """Return the ratio of forecast and taken, marked if it is beyond a factor."""
    ratio = forecast / max(taken, 1e-9)
    within = 1.0 / factor <= ratio <= factor or max(forecast, taken) < SHORTEST_S
    return f"{ratio:7.2f}{' ' if within else '!'}"


def size_of(workspace: Workspace) -> int:
    """Return the bytes of the results and kept items of a workspace."""
    places = ("mapolas", "fused", "bigmaps", "pairs", "release", ".items")
    files = [path for name in places for path in (workspace.home / name).rglob("*")]
    files += workspace.home.glob("*.json")
    files += workspace.home.glob("report.html")
    return sum(path.stat().st_size for path in files if path.is_file())


if __name__ == "__main__":
    main()
