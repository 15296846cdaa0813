"""Wrong input on purpose: what the program accepts, marks as doubtful, and refuses.

Lidar files of synthetic missions are altered (`wrong/alter.py`) and processed by the real commands
with all settings at their defaults: init, import, mapolas, register and, if the registration may be
used, fuse and scale. For each alteration the table gives the step that stopped it and the codes of
its findings; a wrong input that passes all steps is ACCEPTED and counts as a fault.
Correct input are unaltered missions, one for each seed: one that is not accepted is a false alarm.
Their values of the tests of a registration are printed too.

    python scripts/bench/wrong.py [--presets tiny mini] [--seed 3] [--right 20] [--ways WORD...]
                                  [--work DIR]

With `--work` results are kept, and a second run resumes from there.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from wrong.alter import alter

WRONG = (
    "turn 90 z", "turn -90 z", "turn 180 z", "turn 180 x", "turn 90 x", "turn 2.9 z", "turn 2.9 x",
    "turn 5 y", "turn 10 random", "turn 37 random", "turn 133 random",
    "mirror x", "mirror z", "west", "axes YZX", "axes YXZ", "mirror z + turn 40 random",
    "unit 0.001", "unit 1000", "unit 0.3048", "points 1.01", "scale 1.05", "scale 0.8",
    "cloud", "shuffle", "other", "sphere", "relief", "sign", "outliers 0.7", "shift 5 0 0",
    "half + turn 90 z",
)  # fmt: skip
"""Alterations by `alter.py`."""

CENTER_SIGMA_M = 0.05
"""Default of [register] center_sigma_m."""

STEPS = ("mapolas", "register", "fuse", "scale")


def called(*arguments: object) -> tuple[int, dict[str, Any], str]:
    """Run `spcola` in a separate process; return exit code, JSON and last line of errors."""
    command = [sys.executable, "-m", "fusion.cli", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        content = json.loads(done.stdout)
    except ValueError:
        content = {}
    lines = done.stderr.strip().splitlines()
    return done.returncode, content, lines[-1] if lines else ""


def taken_through(workspace: Path, spc: Path, lidar: Path) -> dict[str, Any]:
    """Process SPC files and lidar files by the commands until one of them refuses."""
    shutil.rmtree(workspace, ignore_errors=True)
    called("init", workspace, "--spc", spc, "--body", "Truth")
    begun = time.perf_counter()
    code, _, line = called("import", workspace, *sorted(lidar.iterdir()), "--json")
    result: dict[str, Any] = {
        "verdict": "accepted",
        "step": "",
        "codes": [],
        "line": "",
        "fits": "",
    }
    if code:
        return result | {"verdict": "refused", "step": "import", "line": line}
    for step in STEPS:
        code, content, line = called(step, workspace, "--json")
        summary = content.get("summary", {})
        findings = [found for found in summary.get("findings") or [] if found["severity"] != "note"]
        fits = [found["text"] for found in summary.get("findings") or []
                if found["code"] == "fits-otherwise"]  # fmt: skip
        if step == "register" and not code:
            result["seen"] = seen(summary)
        if code:
            return result | {
                "verdict": summary.get("verdict", "refused"),
                "step": step,
                "codes": sorted({found["code"] for found in findings}),
                "line": line,
                "fits": "; ".join(fits),
                "seconds": time.perf_counter() - begun,
                "rotation_deg": summary.get("rotation_deg"),
            }
    return result | {"seconds": time.perf_counter() - begun}


def seen(summary: dict[str, Any]) -> dict[str, float]:
    """Return the values of the tests of a registration, named as in docs/validation."""
    agreement, landmarks = summary["agreement"], summary["landmarks"]
    used, rejected = summary["n_used"], summary["n_rejected"]
    return {
        "share of mapolas with common relief": agreement["share_with_common_relief"],
        "median clearness": agreement["median_z_score"],
        "heights left over, stated sigmas": agreement["residual_over_sigma"],
        "error of centres over what is stated": summary["maplet_sigma_m"]
        / max(CENTER_SIGMA_M, landmarks["own_sigma_m"]),
        "share of mapolas that agree": used / (used + rejected),
        "probability of the strain by chance": summary["tests"]["strain"]["p_value"],
        "rotation, degrees": max(map(abs, summary["rotation_deg"])),
        "scale less 1": abs(summary["scale"] - 1.0),
    }


def mission(preset: str, seed: int, work: Path) -> Path:
    """Return a mission without images, made now or kept in `work`."""
    folder = work / f"mission-{preset}-{seed}"
    if not (folder / "truth.json").exists():
        code, _, line = called(
            "truth", "make", folder, "--preset", preset, "--seed", seed, "--no-images"
        )
        if code:
            raise SystemExit(line)
    return folder


def tried(preset: str, seed: int, how: str, work: Path) -> dict[str, Any]:
    """Try one alteration, or `right`; earlier results are kept."""
    kept = work / f"{preset}-{seed}-{how.replace(' ', '_').replace('+', 'and')}.json"
    if kept.exists():
        return dict(json.loads(kept.read_text(encoding="utf-8")))
    made = mission(preset, seed, work)
    with tempfile.TemporaryDirectory(dir=work) as folder:
        lidar = made / "lidar"
        if how != "right":
            lidar = Path(folder) / "lidar"
            alter(made / "lidar", lidar, how, seed)
        result = taken_through(Path(folder) / "ws", made / "spc", lidar)
    kept.write_text(json.dumps(result), encoding="utf-8")
    return result


def is_fault(result: dict[str, Any], *, wrong: bool) -> bool:
    """Return whether wrong input passed all steps, or correct input did not."""
    return (result["verdict"] == "accepted") == wrong


def shown(name: str, result: dict[str, Any], *, wrong: bool) -> None:
    """Print one row."""
    verdict = result["verdict"]
    word = verdict.upper() if is_fault(result, wrong=wrong) else verdict
    why = " ".join(result["codes"]) or result["line"][:90]
    fits = f" | {result['fits']}" if result["fits"] else ""
    print(f"{name:34} {word:9} {result['step']:9} {why}{fits}", flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; the exit code is the number of faults, at most 99."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--presets", nargs="+", default=["tiny", "mini"])
    parser.add_argument("--seed", type=int, default=3, help="of the missions that are altered")
    parser.add_argument("--right", type=int, default=20, help="missions of correct input, tiny")
    parser.add_argument("--ways", nargs="+", default=list(WRONG))
    parser.add_argument("--work", type=Path)
    options = parser.parse_args(arguments)
    faults = 0
    with tempfile.TemporaryDirectory() as temporary:
        work = options.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        for preset in options.presets:
            print(f"\n{preset}, seed {options.seed}: wrong input")
            results = {how: tried(preset, options.seed, how, work) for how in options.ways}
            for how, result in results.items():
                shown(how, result, wrong=True)
            missed = sum(is_fault(result, wrong=True) for result in results.values())
            print(f"{len(results)} ways: {missed} accepted")
            faults += missed
        alarms = 0
        ranges: dict[str, list[float]] = {}
        print(f"\n{options.presets[0]}: right input, {options.right} seeds")
        for seed in range(1, options.right + 1):
            result = tried(options.presets[0], seed, "right", work)
            for name, value in result.get("seen", {}).items():
                ranges.setdefault(name, []).append(value)
            if is_fault(result, wrong=False):
                alarms += 1
                shown(f"seed {seed}", result, wrong=False)
        print(f"{options.right} missions: {alarms} not accepted")
        for name, values in ranges.items():
            spread = f"{statistics.fmean(values):.3g} ± {statistics.pstdev(values):.2g}"
            print(f"    {name:40} {min(values):.3g} to {max(values):.3g} ({spread})")
        faults += alarms
    return min(faults, 99)


if __name__ == "__main__":
    raise SystemExit(main())
