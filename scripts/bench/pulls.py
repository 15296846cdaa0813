"""Whether the sigmas are correct: missions of many seeds through the whole program.

For each planted parameter: mean and standard deviation of the pulls (recovered − planted) / sigma;
their root mean square about zero, which includes a bias, with the interval of 95 % and the limit,
1; their excess kurtosis (0 for normal pulls) and its standard error; the rms error and the rms of
the stated sigmas. `--lines FILE` keeps a line for each mission and resumes from there.

    python scripts/bench/pulls.py [--seeds 20] [--preset tiny|mini] [--lines pulls.jsonl]
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from fusion.report.planted import RecoveredParameter
from fusion.runtime import Progress, ThreadExecutor, usable_cores
from fusion.truth import demonstrate
from fusion.truth.presets import MissionSettings
from fusion.truth.pulls import PullStatistics, pull_statistics

PRESETS = {"tiny": MissionSettings.tiny, "mini": MissionSettings.mini}


def recovered(preset: str, seed: int) -> list[RecoveredParameter]:
    """Make a mission, run all stages on it, and return the recovered values."""
    settings = PRESETS[preset](seed)
    with tempfile.TemporaryDirectory() as folder:
        shown = demonstrate(
            Path(folder) / "demo",
            ThreadExecutor(usable_cores()),
            Progress.fitting(silent=True),
            settings=settings,
        )
    return shown.recovered


def missions(
    kind: Mapping[str, Any],
    make: Callable[[int], list[RecoveredParameter]],
    options: argparse.Namespace,
) -> None:
    """Print the pulls of the missions of all seeds.

    Parameters
    ----------
    kind : mapping
        What determines a mission besides its seed; it stands in the lines that are kept.
    make : callable
        Makes the mission of a seed, and returns the recovered values.
    options : Namespace
        Of :func:`parser_of`.
    """
    known, lines = {}, options.lines
    if lines and lines.exists():
        entries = map(json.loads, lines.read_text(encoding="utf-8").splitlines())
        known = {
            entry["seed"]: [RecoveredParameter(**row) for row in entry["rows"]]
            for entry in entries
            if entry["kind"] == kind
        }
    seeds = range(options.first, options.first + options.seeds)
    for seed in (seed for seed in seeds if seed not in known):
        start = time.perf_counter()
        known[seed] = make(seed)
        entry = {"kind": kind, "seed": seed, "rows": [asdict(row) for row in known[seed]]}
        if lines:
            with lines.open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")
        print(f"seed {seed}: {time.perf_counter() - start:.0f} s", flush=True)
    print(f"\n{', '.join(map(str, kind.values()))}, seeds {seeds.start} to {seeds.stop - 1}")
    print("\n".join(table(pull_statistics([known[seed] for seed in seeds]))))


def table(found: list[PullStatistics]) -> Iterator[str]:
    """Yield the lines of the table."""
    yield (
        f"{'parameter':28}{'n':>4}{'mean pull':>16}{'std':>6}{'rms pull':>10}{'95 %':>14}"
        f"{'limit':>7}{'kurtosis':>15}{'rms error':>12}{'rms sigma':>12}"
    )
    for row in found:
        mean = f"{row.mean:+.2f} ± {row.mean_sigma:.2f}"
        interval = f"{row.lowest:.2f} – {row.highest:.2f}"
        tails = f"{row.kurtosis:+.2f} ± {math.sqrt(24 / max(row.count, 1)):.2f}"
        yield (
            f"{row.name:28}{row.count:>4}{mean:>16}{row.scatter:>6.2f}"
            f"{row.deviation:>10.2f}{interval:>14}{1:>7}{tails:>15}"
            f"{row.error:>12.2e}{row.sigma:>12.2e}  {row.unit}".rstrip()
        )
    for row in found:
        if row.missing:
            yield f"not recovered in {row.missing} missions: {row.name}"


def parser_of(description: str) -> argparse.ArgumentParser:
    """Return a parser of the options of :func:`missions`."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seeds", type=int, default=20, help="how many, from --first on")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--preset", choices=sorted(PRESETS), default="mini")
    parser.add_argument("--lines", type=Path, help="keep a line for each mission in this file")
    return parser


def main() -> None:
    options = parser_of("Pulls of the recovered parameters over seeds.").parse_args()
    missions({"preset": options.preset}, partial(recovered, options.preset), options)


if __name__ == "__main__":
    main()
