"""Accuracy of the pipeline on synthetic missions, and the cost of each step.

For each preset and seed the real commands are run, each in a separate process: make, init, import,
the stages up to the scale, assess. Printed: seconds and peak memory of each step, a table of the
models (SPC maplets, mapolas, fused maplets) and one of the recovered parameters. SPC maplets should
be like the published model of Weirich et al. (35 cm model, Table 3). For definitions of all numbers
see `definitions` in `spcola truth assess --json`.

    python scripts/bench/truth.py [--presets mini] [--seeds 3] [--work DIR] [--no-images]

With `--work` results are kept, and a second run resumes from there.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

STAGES = ("mapolas", "register", "fuse", "bigmap", "scale")
MODELS = ("SPC maplets", "mapolas, registered", "fused maplets")
REGIONS = ("lit", "shadowed", "boulders", "craters", "smooth site", "other ground")
PUBLISHED = "Weirich, 35 cm model: optimised 3D rms 0.10 m, FormU 0.06 m, ratio within 0.5 – 2"
_GIB = 2.0**20


def timed(arguments: Sequence[object], out: Path | None = None) -> dict[str, float]:
    """Run `spcola` with `arguments` in a separate process; return seconds and peak GiB."""
    command = [sys.executable, "-m", "fusion.cli", *map(str, arguments)]
    start = time.perf_counter()
    with (out or Path(os.devnull)).open("wb") as target:
        process = subprocess.Popen(command, stdout=target)
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(map(str, arguments))}: exit {process.returncode}")
    return {"seconds": time.perf_counter() - start, "gib": used.ru_maxrss / _GIB}


def measured(preset: str, seed: int, work: Path, *, images: bool) -> dict[str, Any]:
    """Return the steps' costs and the assessment of one mission, made now or kept in `work`."""
    root = work / f"{preset}{seed}"
    kept = root / "result.json"
    if kept.exists():
        return dict(json.loads(kept.read_text(encoding="utf-8")))
    root.mkdir(parents=True, exist_ok=True)
    mission, workspace, assessed = root / "mission", root / "workspace", root / "assess.json"
    choice = [] if images else ["--no-images"]
    steps = {"make": timed(["truth", "make", mission, "--preset", preset, "--seed", seed, *choice])}
    shutil.rmtree(workspace, ignore_errors=True)
    timed(["init", workspace, "--spc", mission / "spc", "--body", "Truth"])
    steps["import"] = timed(["import", workspace, *sorted((mission / "lidar").iterdir())])
    for stage in STAGES:
        steps[stage] = timed([stage, workspace])
    page = root / "assess.html"
    steps["assess"] = timed(
        ["truth", "assess", workspace, "--truth", mission, "--report", page, "--json"], assessed
    )
    result = {
        "preset": preset,
        "seed": seed,
        "steps": steps,
        "assessment": json.loads(assessed.read_text(encoding="utf-8")),
    }
    kept.write_text(json.dumps(result), encoding="utf-8")
    return result


def cost_lines(results: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the costs of the steps."""
    names = list(results[0]["steps"])
    yield f"{'seconds / peak GiB':20}" + "".join(f"{name:>14}" for name in names)
    for result in results:
        cells = [f"{s['seconds']:.0f} / {s['gib']:.2f}" for s in result["steps"].values()]
        head = f"{result['preset']} {result['seed']}"
        yield f"{head:20}" + "".join(f"{cell:>14}" for cell in cells)


def number(value: float | None, form: str = "{:.3f}") -> str:
    """Return a number, or a dash for None."""
    return "–" if value is None else form.format(value)


def model_lines(results: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the models' scores: lengths in metres."""
    yield (
        f"{'':32}{'3D rms':>8}{'optim.':>8}{'slope':>7}{'resol.':>8}{'FormU/':>8}  "
        + "".join(f"{region[:10]:>22}" for region in REGIONS)
    )
    yield f"{'':63}{'optim.':>8}  " + f"{'rms   1σ   2σ  pull':>22}" * len(REGIONS)
    for result in results:
        found = result["assessment"]
        for model in found["models"]:
            if model["name"] not in MODELS:
                continue
            head = f"{result['preset']} {result['seed']} {model['name']}"
            cells = [
                f"{number(model['rms_3d_m']):>8}{number(model['rms_3d_optimised_m']):>8}",
                f"{number(model['regions']['all']['slope_rms_deg'], '{:.1f}°'):>7}",
                f"{number(model['resolution_m'], '{:.2f}'):>8}",
                f"{number(model['formu_ratio'], '{:.2f}'):>8}  ",
                *(f"{region_cell(model['regions'][region]):>22}" for region in REGIONS),
            ]
            yield f"{head:32}{''.join(cells)}"
    for result in results:
        formal = result["assessment"]["formal_uncertainty"]
        if formal:
            yield f"{result['preset']} {result['seed']}: FormU {formal['formu_m']:.3f} m"
    yield PUBLISHED


def region_cell(region: dict[str, Any]) -> str:
    """Return rms, the shares within one and two sigma, and the pulls' deviation of a region."""
    if not region["points"]:
        return "–"
    shares = [number(region[f"within_{k}_sigma"], "{:.2f}") for k in (1, 2)]
    return f"{region['rms_m']:.3f} {shares[0]} {shares[1]} {number(region['pull_std'], '{:.2f}')}"


def recovered_lines(results: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the recovered parameters: error ± stated sigma, and the pull."""
    heads = [f"{result['preset']} {result['seed']}" for result in results]
    yield f"{'recovered − planted':28}" + "".join(f"{head:>28}" for head in heads)
    tables = [{row["name"]: row for row in result["assessment"]["recovered"]} for result in results]
    for name in dict.fromkeys(name for table in tables for name in table):
        cells = [pull_cell(table.get(name)) for table in tables]
        unit = next(table[name]["unit"] for table in tables if name in table)
        yield f"{name:28}" + "".join(f"{cell:>28}" for cell in cells) + f"  {unit}"


def pull_cell(row: dict[str, Any] | None) -> str:
    if row is None or row["recovered"] is None or row["pull"] is None:
        return "–"
    return f"{row['recovered'] - row['planted']:+.1e} ± {row['sigma']:.1e} ({row['pull']:+.1f})"


def main() -> None:
    parser = argparse.ArgumentParser(description="The pipeline on synthetic missions.")
    parser.add_argument(
        "--presets", nargs="+", default=["mini"], choices=["tiny", "mini", "pole", "bennu"]
    )
    parser.add_argument("--seeds", type=int, default=3, help="how many, from --first on")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--work", type=Path, help="keep missions and results in this folder")
    parser.add_argument("--no-images", action="store_true", help="render none: none is used yet")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = options.work or Path(folder)
        for preset in options.presets:
            seeds = range(options.first, options.first + options.seeds)
            results = [measured(preset, s, work, images=not options.no_images) for s in seeds]
            for lines in (cost_lines, model_lines, recovered_lines):
                print("\n" + "\n".join(lines(results)), flush=True)


if __name__ == "__main__":
    main()
