"""Photoclinometry on synthetic missions: what images, lidar and both are worth, and what it costs.

For each seed the real commands make a mission, its mapolas, registration and fused maplets, and
four solutions from images: alone from the shape, with mapolas, with the returns themselves, and
`fuse --from images`. Each is compared with the truth, like today's SPC maplets, mapolas and fused
maplets (rms of heights and slopes, resolution, sigmas). With several seeds a last table has the
pulls and the shares of errors within one and two sigma, of each model and region of `truth assess`,
over all seeds. `--densities` makes the mission again with a lidar that is thinner by these factors
(with mapolas of 2 m where returns would not cover finer ones), `--speed` times one maplet of
99 x 99 points and profiles it.

    python scripts/bench/photoclinometry.py [--preset mini] [--seeds 1] [--work DIR]
        [--densities 10 100] [--speed]

With `--work` results are kept, and a second run resumes from there.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from truth import timed

from fusion.estimation.verdict import Verdict
from fusion.runtime.machine.threads import one_blas_thread
from fusion.stages.register import ImageScene
from fusion.truth.presets import MissionSettings
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import load_settings, write_settings
from fusion.workspace.settings.processing import RegisterSettings
from spcola.grids import Maplet, MapletGrid
from spcola.imagematching import ChoiceOptions
from spcola.photometry.photoclinometry import (
    HeightConstraint,
    PhotoclinometryOptions,
    solve_photoclinometry,
)
from spcola.shape import shape_heights

ALONE = ("--constraint", "shape")
LIDAR = ("--constraint", "shape", "--constraint", "lidar")
RETURNS = ("--constraint", "shape", "--constraint", "returns")
SOLUTIONS = {
    "images alone": ("spc", "lithos", "--start", "shape", *ALONE, "--as", "images"),
    "images, lidar": ("spc", "lithos", "--start", "shape", *LIDAR, "--as", "lidar"),
    "images, returns": ("spc", "lithos", "--start", "shape", *RETURNS, "--as", "returns"),
    "fuse --from images": ("fuse", "--from", "images", "--as", "spcola"),
}
COLUMNS = ("heights", "lit", "shadowed", "lit slope", "resolved", "pull", "1 sigma", "2 sigma")
# Goals of the issue: slopes with images alone; gain in slopes over the better of both; sigmas.
SLOPE_GOAL_DEG, GAIN_GOAL = 3.0, 0.75
# Wanted share of errors within so many sigmas, and how far it may be from that.
SHARES = {1: (0.68, 0.08), 2: (0.95, 0.03)}
# Lidar thinner than this leaves nine of ten cells of mapolas of half a metre empty.
COVERED = 30.0
# Parts of a maplet's time: what they do, and the files and functions that do it.
PARTS = {
    "rays to Sun and camera": ("shadows",),
    "resampling, cells over pixels": ("box_cells", "sharpen_cells", "spread_cells"),
    "brightness": ("shade_cells",),
    "normal equations": ("gather_cells",),
    "weights of pixels": ("pixel_weights",),
    "heights and albedo": (
        "surface_equations", "albedo_equations", "_factorise", "_substitute", "_multiply",
        "_multiply_rows", "_subtract_rows", "_assemble", "_conjugate",
    ),
    "sigmas": ("posterior", "banded", "_direct_of_nuisances", "_blocks"),
}  # fmt: skip
# Published: 418 computer hours for the maplets of 18 cm of a body of 500 m.
POINTS, IMAGES, ROUNDS = 99, 50, 10
GOAL = "goal 1.5 s for 50 images and 10 rounds"


def prepared(work: Path, preset: str, seed: int, thinner: float) -> Path:
    """Make a mission and a registered workspace with fused maplets; return the latter."""
    root = work / f"{preset}{seed}-{thinner:g}"
    workspace, mission = root / "workspace", root / "mission"
    if (root / "fused.done").exists():
        return workspace
    spacing = getattr(MissionSettings, preset)(seed).lidar.spacing * np.sqrt(thinner)
    timed(["truth", "make", mission, "--preset", preset, "--seed", seed, "--images",
           "--set", f"lidar.spacing={spacing:.6f}"])  # fmt: skip
    if not workspace.exists():
        timed(["init", workspace, "--spc", mission / "spc", "--body", "Truth"])
    if thinner > COVERED:
        settings = load_settings(workspace / SETTINGS_FILE)
        settings = settings.with_table("mapolas", gsd_m=2.0, half_size=12)
        settings = settings.with_table("lithos", constraints=["shape", "returns"])
        write_settings(workspace / SETTINGS_FILE, settings)
    timed(["import", workspace, *sorted((mission / "lidar").iterdir())])
    for stage in ("mapolas", "register"):
        timed([stage, workspace])
    accept = findings(workspace, "registration.json")
    timed(["fuse", workspace, *accept])
    (root / "fused.done").touch()
    return workspace


def findings(workspace: Path, name: str) -> list[str]:
    """Options that accept the findings of a doubtful registration, as a scientist would."""
    verdict = Verdict.from_json(Workspace.open(workspace).read_json(name))
    codes = [str(finding.code) for finding in verdict.findings]
    return [part for code in codes for part in ("--accept", code)] if verdict.obstacle([]) else []


def solved(workspace: Path, thinner: float) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Make the solutions that are not there yet; yield name, seconds, and what each found."""
    accept = findings(workspace, "registration.json")
    for name, (*command, last) in SOLUTIONS.items():
        # Mapolas that are coarser than the maplets are refused.
        if "lidar" in command and thinner > COVERED:
            continue
        kept = workspace.parent / f"{last}.json"
        if not kept.exists():
            extra = accept if {"lidar", "returns", "fuse"} & {*command} else []
            at = 1 if command[0] == "fuse" else 2
            used = timed([*command[:at], workspace, *command[at:], last, *extra])
            found = Workspace.open(workspace, last).read_json("photoclinometry.json")
            found = {"outcomes": found["outcomes"], "residual": found["residual"], **used}
            kept.write_text(json.dumps(found), encoding="utf-8")
        found = json.loads(kept.read_text(encoding="utf-8"))
        yield name, found["seconds"], found


def assessed(workspace: Path, solution: str | None = None) -> dict[str, dict[str, Any]]:
    """Return the assessed models of a solution, or of the imported one, by their names."""
    kept = workspace.parent / f"assessed-{solution or 'imported'}.json"
    if not kept.exists():
        chosen = ["--solution", solution] if solution else []
        mission = workspace.parent / "mission"
        timed(["truth", "assess", workspace, "--truth", mission, *chosen, "--json"], out=kept)
    content = json.loads(kept.read_text(encoding="utf-8"))
    return {model["name"]: model for model in content["models"]}


def columns(model: dict[str, Any]) -> list[float]:
    """Return the numbers of :data:`COLUMNS` of an assessed model."""

    def at(*keys: str) -> float:
        found: Any = model
        for key in keys:
            found = found.get(key) if isinstance(found, dict) else None
        return float("nan") if found is None else float(found)

    heights = [at("regions", region, "rms_m") for region in ("all", "lit", "shadowed")]
    sigmas = [at("regions", "all", f"within_{count}_sigma") for count in (1, 2)]
    slopes = at("regions", "lit", "slope_rms_deg")
    return [*heights, slopes, at("resolution_m"), at("regions", "all", "pull_std"), *sigmas]


def table(rows: dict[str, list[float]]) -> Iterator[str]:
    """Yield lines of the columns of each model."""
    yield f"{'':24}" + "".join(f"{name:>10}" for name in COLUMNS)
    for name, values in rows.items():
        yield f"{name:24}" + "".join(f"{value:10.3f}" for value in values)


def gain(work: Path, preset: str, seed: int, thinner: float) -> Iterator[str]:
    """Yield the table of one mission, costs and outcomes."""
    workspace = prepared(work, preset, seed, thinner)
    rows = {name: columns(model) for name, model in assessed(workspace).items()}
    yield f"{preset}, seed {seed}, lidar thinner by {thinner:g}"
    for name, seconds, found in solved(workspace, thinner):
        last = SOLUTIONS[name][-1]
        rows[name] = columns(assessed(workspace, last)["SPC maplets"])
        outcomes = ", ".join(f"{count} {code}" for code, count in found["outcomes"].items())
        yield f"  {name}: {seconds:.0f} s, {found['gib']:.2f} GiB; {outcomes}"
    yield from table(rows)
    alone = rows["images alone"][3]
    better = min(alone, rows["mapolas, registered"][3])
    both = min(rows[name][3] for name in ("images, lidar", "images, returns") if name in rows)
    yield f"  slopes with images alone: {alone:.2f} deg (goal {SLOPE_GOAL_DEG:g})"
    yield (
        f"  slopes with lidar over the better of both alone: {both / better:.2f} (goal {GAIN_GOAL})"
    )


def sigma_lines(workspaces: Sequence[Path]) -> Iterator[str]:
    """Yield pulls and shares within sigmas of each model and region, over some missions."""
    missions = [models_with_sigmas(workspace) for workspace in workspaces]
    heads = f"{'points':>10}{'pull mean':>11}{'std':>6}{'1 sigma':>20}{'2 sigma':>20}"
    yield f"{len(missions)} missions: shares over all points, and of single missions"
    yield f"{'':42}{heads}  as wanted"
    for name in missions[0]:
        for region in missions[0][name]["regions"]:
            scores = [mission[name]["regions"][region] for mission in missions]
            yield f"{name:20}{region:22}{over_missions([s for s in scores if s['points']])}"


def models_with_sigmas(workspace: Path) -> dict[str, dict[str, Any]]:
    """Return the assessed models of a mission that state sigmas, solutions from images included."""
    models = assessed(workspace)
    for name, (*_, last) in SOLUTIONS.items():
        models[name] = assessed(workspace, last)["SPC maplets"]
    return {
        name: model
        for name, model in models.items()
        if model["regions"]["all"]["pull_std"] is not None
    }


def over_missions(scores: Sequence[dict[str, Any]]) -> str:
    """Return points, pulls and shares within sigmas of one region over some missions."""
    count, middle, spread = (
        np.array([score[key] for score in scores]) for key in ("points", "pull_mean", "pull_std")
    )
    mean = float(np.average(middle, weights=count))
    deviation = np.sqrt(np.average(spread**2 + (middle - mean) ** 2, weights=count))
    cells, right = "", True
    for sigmas, (wanted, most) in SHARES.items():
        shares = [score[f"within_{sigmas}_sigma"] for score in scores]
        share = float(np.average(shares, weights=count))
        cells += f"{share:8.3f} ({min(shares):.2f} - {max(shares):.2f})"
        right &= abs(share - wanted) <= most
    return f"{count.sum():10}{mean:11.2f}{deviation:6.2f}{cells}  {'yes' if right else 'no'}"


def speed(workspace: Path) -> Iterator[str]:
    """Yield the time of one maplet, and the shares of its parts."""
    space = Workspace.open(workspace)
    grids = [space.maplet(name).grid for name in space.maplet_names()]
    scene = ImageScene.of(space, grids, RegisterSettings())
    scene = replace(scene, choice=ChoiceOptions(most=IMAGES))
    assert scene.beyond is not None
    shown = max(grids, key=lambda grid: len(scene.showing(grid)))
    grid = MapletGrid(shown.center, shown.axes, shown.gsd, POINTS // 2)
    real = [scene.exposed(image) for image in scene.showing(grid)]
    height = shape_heights(scene.beyond, grid, reach=grid.radius)
    shape = HeightConstraint.of_sigma("shape", height, grid.gsd, common=100.0)
    # Those of the mission again and again, under other names.
    images = [replace(real[k % len(real)], name=f"{k:012d}") for k in range(IMAGES)]
    states = {one.name: scene.states[real[k % len(real)].name] for k, one in enumerate(images)}

    def run(count: int, rounds: int, settled_gsd: float = 1e-9) -> tuple[float, int]:
        """Seconds and rounds of so many images, at most so many rounds at each GSD."""
        options = PhotoclinometryOptions(rounds=rounds, settled_gsd=settled_gsd)
        with one_blas_thread():
            start = time.process_time()
            found = solve_photoclinometry(
                Maplet("SPEED", grid, height), images[:count], states, constraints=[shape],
                beyond=[scene.beyond], options=options,
            )  # fmt: skip
            return time.process_time() - start, len(found.rounds)

    run(IMAGES, 1)
    yield (
        f"one maplet of {POINTS} x {POINTS}, {len(real)} images of the mission repeated, at three "
        "GSDs, 4, 2 and 1 times its own; at the coarsest as many rounds with the Suns turned, "
        "which do not count; processor time of one core"
    )
    settled = PhotoclinometryOptions.settled_gsd
    for count, *given in ((IMAGES, 3), (IMAGES, 4), (IMAGES, 12, settled), (IMAGES, ROUNDS),
                          (IMAGES // 2, ROUNDS)):  # fmt: skip
        used, rounds = min(run(count, *given) for _ in range(3))
        how = "as it settles" if len(given) > 1 else f"{given[0]} rounds at each GSD"
        yield f"  {count} images, {how}, {rounds} rounds: {used:.2f} s ({GOAL})"
    profile = cProfile.Profile()
    profile.runcall(run, IMAGES, ROUNDS)
    yield from shares(pstats.Stats(profile))


def shares(profile: pstats.Stats) -> Iterator[str]:
    """Yield the share of each part of a profile, by the files and functions that :data:`PARTS` has.

    Time counts where it is spent; that in libraries is in the rest.
    """
    used = dict.fromkeys([*PARTS, "rest"], 0.0)
    for (file, _, function), (_, _, own, _, _) in profile.stats.items():  # type: ignore[attr-defined]
        places = {Path(file).stem, function}
        part = next((name for name, of in PARTS.items() if places & {*of}), "rest")
        used[part] += own
    whole = sum(used.values())
    for name, seconds in used.items():
        yield f"    {name}: {seconds / whole:.0%}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="mini")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--densities", type=float, nargs="*", default=[])
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--work", type=Path)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        work = given.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        seeds = range(1, given.seeds + 1)
        for seed in seeds:
            for thinner in (1.0, *given.densities):
                for line in gain(work, given.preset, seed, thinner):
                    print(line, flush=True)
        if len(seeds) > 1:
            missions = [prepared(work, given.preset, seed, 1.0) for seed in seeds]
            for line in sigma_lines(missions):
                print(line, flush=True)
        if given.speed:
            for line in speed(prepared(work, given.preset, 1, 1.0)):
                print(line, flush=True)


if __name__ == "__main__":
    main()
