"""Gain of fusing: fused maplets compared with either source alone, by region.

For each seed the real commands make a mission, its mapolas, registration and fused maplets. Every
model is compared with the truth on its own grid; ratios are those of the issue: fused over the
better of SPC alone and mapolas alone. Mapolas alone are taken twice: as they are, and made without
the adjustment of scans (`[mapolas] adjust = false`), which is gridding alone.

Printed: rms of the heights by region, ratios and their bars, errors at the tops of boulders, shares
of the errors within one and two sigma and their bars, resolution, disagreement of neighbouring
maplets in their overlap; and, from the truth, the best that any weights of both sources could
reach, and the errors left after the best movement of the whole surface (moved.py).

    python scripts/bench/fused.py [--preset mini] [--seeds 3] [--work DIR]
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from moved import Errors
from scipy.ndimage import label, maximum_position
from truth import number, timed

from fusion.scene import Scene
from fusion.truth import read_truth
from fusion.truth.assessment import AssessmentSettings, workspace_models
from fusion.truth.assessment.assessment import light_on
from fusion.truth.assessment.model import Model
from fusion.truth.assessment.patches import patch_errors
from fusion.truth.assessment.regions import REGIONS, Ground
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import write_settings
from spcola.arrays import FloatArray
from spcola.grids import Maplet, overlaps, project_maplet

NAMED = ("lit", "shadowed", "boulders")
SPC, MAPOLAS, FUSED = "SPC maplets", "mapolas, registered", "fused maplets"
# A boulder of fewer cells has no top on the grid.
LEAST_CELLS = 4
PAIRS = 200
# Points at the border that interpolation may not reach.
EDGE = 3


def prepared(root: Path, mission: Path, name: str, *, adjust: bool) -> Path:
    """Bring one workspace up to fused maplets, if it is not there yet."""
    workspace = root / name
    done = root / f"{name}.done"
    if done.exists():
        return workspace
    timed(["init", workspace, "--spc", mission / "spc", "--body", "Truth"])
    settings = Workspace.open(workspace).settings()
    settings = settings.with_table("mapolas", adjust=adjust)
    write_settings(workspace / SETTINGS_FILE, settings)
    timed(["import", workspace, *sorted((mission / "lidar").iterdir())])
    for stage in ("mapolas", "register", "fuse"):
        cost = timed([stage, workspace])
        print(f"  {name} {stage}: {cost['seconds']:.0f} s, {cost['gib']:.2f} GiB", flush=True)
    done.touch()
    return workspace


def assessed(workspace: Path, mission: Path, out: Path) -> dict[str, Any]:
    """Return the assessment of a workspace, made now or kept."""
    if not out.exists():
        timed(["truth", "assess", workspace, "--truth", mission, "--json"], out)
    models = json.loads(out.read_text(encoding="utf-8"))["models"]
    return {model["name"]: model for model in models}


def tops(workspace: Path, mission: Path) -> dict[str, float]:
    """Return the rms error at the tops of boulders, metres, by model."""
    planted = read_truth(mission)
    ground = Ground(body := planted.body(), light_on(planted, body), AssessmentSettings())
    bit = REGIONS.index("boulders")
    found: dict[str, float] = {}
    for model in workspace_models(Workspace.open(workspace)):
        if model.name not in (SPC, MAPOLAS, FUSED):
            continue
        errors: list[float] = []
        for key in model.keys(AssessmentSettings().patches):
            patch = patch_errors(model.patch(key), ground, planted.similarity)
            known = np.isfinite(patch.error)
            inside = np.zeros(known.shape, dtype=bool)
            inside[known] = (patch.points.regions >> bit) & 1 > 0
            errors += list(_errors_at_tops(patch.truth, patch.error, inside))
        found[model.name] = float(np.sqrt(np.mean(np.square(errors)))) if errors else np.nan
    return found


def _errors_at_tops(truth: FloatArray, error: FloatArray, inside: FloatArray) -> Iterator[float]:
    labels, count = label(inside)
    size = np.bincount(labels.ravel(), minlength=count + 1)
    for boulder in range(1, count + 1):
        if size[boulder] >= LEAST_CELLS:
            yield float(error[maximum_position(truth, labels, boulder)])


def seams(model: Model) -> float:
    """Return the rms difference, metres, of neighbouring maplets where they overlap."""
    grids = {key: model.patch(key) for key in model.keys(1 << 20)}
    names, squares = sorted(grids), []
    for number_, one in enumerate(names):
        for other in names[number_ + 1 :]:
            if overlaps(grids[one].grid, grids[other].grid):
                squares.append((one, other))
    step = max(1, len(squares) // PAIRS)
    gaps = [_gap(grids[one], grids[other]) for one, other in squares[::step]]
    return float(np.sqrt(np.mean(np.concatenate(gaps) ** 2)))


def _gap(one: Maplet, other: Maplet) -> FloatArray:
    gap = project_maplet(other, one.grid).height - one.height
    return gap[np.isfinite(gap)]


def limit(workspace: Path, mission: Path) -> str:
    """Return the error of the best combination of both sources, with two weights per wavelength.

    The weights minimise the error against the truth (Wiener), so that no other linear combination
    that is the same for all places is better. Over the inner squares of maplets without gaps in
    either source, with planes removed and Hann windows.
    """
    planted = read_truth(mission)
    ground = Ground(body := planted.body(), light_on(planted, body), AssessmentSettings())
    scene = Scene.of(Workspace.open(workspace))
    spectra: list[tuple[FloatArray, ...]] = []
    for name in scene.targets:
        parts = scene.parts(name)
        fused = Workspace.open(workspace).fused(name)
        truth = patch_errors(fused, ground, planted.similarity).truth
        layers = [parts.lidar.height, parts.spc.height, fused.height, truth]
        inner = [layer[EDGE:-EDGE, EDGE:-EDGE] for layer in layers]
        if np.isfinite(inner).all():
            spectra.append(_ring_sums(*inner))
    if not spectra:
        return "limit           no maplet without gaps in both sources"
    sources, with_truth, truth_power, lidar_error, fused_error = (
        np.sum(each, axis=0) for each in zip(*spectra, strict=True)
    )
    whole = lidar_error.sum()
    both = _least(sources, with_truth, truth_power) / whole
    smoothed = _least(sources[:, :1, :1], with_truth[:, :1], truth_power) / whole
    return (
        f"limit           best weights for each wavelength, by the truth: "
        f"{np.sqrt(both):.2f} of mapolas, of the mapolas alone {np.sqrt(smoothed):.2f}; "
        f"fused {np.sqrt(fused_error.sum() / whole):.2f} ({len(spectra)} maplets)"
    )


def _least(sources: FloatArray, with_truth: FloatArray, truth_power: FloatArray) -> float:
    """Return the error power that the best weights of each wavelength leave."""
    left = 0.0
    for ring in np.nonzero(truth_power > 0)[0]:
        weights = np.linalg.lstsq(sources[ring], with_truth[ring], rcond=1e-12)[0]
        left += truth_power[ring] - with_truth[ring] @ weights
    return left


def _ring_sums(
    lidar: FloatArray, spc: FloatArray, fused: FloatArray, truth: FloatArray
) -> tuple[FloatArray, ...]:
    """Sums over rings of wavenumber: of both sources, with the truth, of it, and of errors."""
    size = len(truth)
    y, x = np.mgrid[:size, :size] / size
    plane = np.stack([np.ones(size * size), x.ravel(), y.ravel()], axis=1)
    window = np.hanning(size)[:, None] * np.hanning(size)

    def wave(layer: FloatArray) -> FloatArray:
        rest = layer.ravel() - plane @ np.linalg.lstsq(plane, layer.ravel(), rcond=None)[0]
        return np.fft.fft2(rest.reshape(size, size) * window)

    one, two, made, true = (wave(layer) for layer in (lidar, spc, fused, truth))
    k = np.fft.fftfreq(size) * size
    ring = np.rint(np.hypot(k[:, None], k)).astype(int).ravel()

    def total(values: FloatArray) -> FloatArray:
        return np.bincount(ring, weights=values.real.ravel())

    both = [[total(a * b.conj()) for b in (one, two)] for a in (one, two)]
    with_truth = [total(a * true.conj()) for a in (one, two)]
    return (
        np.moveaxis(np.array(both), -1, 0),
        np.moveaxis(np.array(with_truth), -1, 0),
        total(true * true.conj()),
        total((one - true) * (one - true).conj()),
        total((made - true) * (made - true).conj()),
    )


def lines(models: dict[str, Any], raw: dict[str, Any], name: str) -> Iterator[str]:
    """Yield the table of one mission."""
    spc, mapolas, fused = (models[each] for each in (SPC, MAPOLAS, FUSED))
    alone = raw[MAPOLAS]
    yield f"{name:14}" + "".join(f"{region:>28}" for region in REGIONS[1:7])

    def row(title: str, value: Callable[[str], str]) -> str:
        return f"{title:14}" + "".join(f"{value(region):>28}" for region in REGIONS[1:7])

    def rms(model: dict[str, Any], region: str) -> float:
        score = model["regions"].get(region, {})
        return float(score.get("rms_m") or np.nan)

    for title, model in (
        ("SPC", spc),
        ("mapola raw", alone),
        ("mapola", mapolas),
        ("fused", fused),
    ):
        yield row(title, lambda region, model=model: number(_known(rms(model, region)), "{:.4f} m"))
    yield row("ratio to raw", lambda r: _ratio(rms(fused, r), rms(spc, r), rms(alone, r)))
    yield row("ratio", lambda r: _ratio(rms(fused, r), rms(spc, r), rms(mapolas, r)))
    yield row("within 1, 2 σ", lambda r: _shares(fused["regions"].get(r, {})))
    cells = [f"{t} {number(m['resolution_m'], '{:.2f}')} m" for t, m in _titled(models)]
    yield f"{'resolution':14}  " + ", ".join(cells)


def _titled(models: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for title, name in (("SPC", SPC), ("mapola", MAPOLAS), ("fused", FUSED)):
        yield title, models[name]


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _ratio(fused: float, spc: float, mapola: float) -> str:
    best = np.fmin(spc, mapola)
    return number(_known(fused / best), "{:.2f}")


def _shares(score: dict[str, Any]) -> str:
    return " ".join(number(score.get(f"within_{k}_sigma"), "{:.3f}") for k in (1, 2))


def mission_of(root: Path, preset: str, seed: int) -> Path:
    """Make one mission, if it is not there yet."""
    mission = root / "mission"
    if not (mission / "truth.json").exists():
        timed(["truth", "make", mission, "--preset", preset, "--seed", seed])
    return mission


def report(preset: str, seed: int, work: Path) -> Sequence[str]:
    """Make, fuse, compare; return the table."""
    root = work / f"{preset}{seed}"
    root.mkdir(parents=True, exist_ok=True)
    mission = mission_of(root, preset, seed)
    workspace = prepared(root, mission, "workspace", adjust=True)
    plain = prepared(root, mission, "plain", adjust=False)
    models = assessed(workspace, mission, root / "fused.json")
    raw = assessed(plain, mission, root / "plain.json")
    report_lines = list(lines(models, raw, f"{preset} {seed}"))
    top = tops(workspace, mission)
    report_lines.append(
        "boulder tops    "
        + ", ".join(f"{name} {value:.3f} m" for name, value in top.items())
        + f"; fused / SPC {top[FUSED] / top[SPC]:.2f}"
    )
    report_lines.append(limit(workspace, mission))
    report_lines += Errors(workspace, mission).lines()
    gaps = {m.name: seams(m) for m in workspace_models(Workspace.open(workspace)) if m.name in top}
    report_lines.append(
        "seams           " + ", ".join(f"{name} {v:.4f} m" for name, v in gaps.items())
    )
    return report_lines


def main() -> None:
    parser = argparse.ArgumentParser(description="Gain of fusing on synthetic missions.")
    parser.add_argument("--preset", default="mini")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--work", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        work = options.work or Path(scratch)
        for seed in range(1, options.seeds + 1):
            for line in report(options.preset, seed, work):
                print(line, flush=True)
            print()
    print("bars: lit ratio ≤ 0.70, shadowed ≤ 1.05 of mapolas, tops ≤ 0.50 of SPC,")
    print(
        "      within 1 σ 0.60 – 0.76, within 2 σ 0.92 – 0.98, resolution that of the better source"
    )


if __name__ == "__main__":
    main()
