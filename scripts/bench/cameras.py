"""Cameras: accuracy of both directions, of line scans, and of calibration by stars.

Prints, each with its limit: the largest disagreement of the two directions of each model of
distortion over the detector and of a line scan with jitter, in pixels; with `--data` the scatter of
the LROC NAC's control points; over seeds of synthetic star fields the standard deviation of
(solved − planted) / sigma, and the shares of stars that were identified, and identified wrongly.

    python scripts/bench/cameras.py [--seeds 60] [--data ../shared/data]
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.camera import Camera, rotate_axes
from spcola.camera.distortion import distort, undistort
from spcola.camera.linescan import LineScan, project_scan, scan_rays
from spcola.camera.projection import project_vectors
from spcola.camera.stars import (
    StarCatalogue,
    StarFrame,
    StarPositions,
    calibrate,
    identified_frame,
    solved_parameters,
)
from spcola.camera.stars.parameters import SolvedParameters
from spcola.errors import NotObservableError
from spcola.formats.cameras import read_isd

LIMIT_PX = 1e-3
SIGMA_PX = 0.1
# Model, focal length and pixel (mm), size, coefficients of missions.
MODELS = {
    "owen": (125.2, 0.0085, 1024, [2e-5, -3e-7, 3e-5, -2e-5]),
    "brown": (7.64, 0.0022, 2592, [-0.53766, 0.37526, 2.3432e-4, 9.0875e-4, -0.18368]),
    "hasselblad": (76.054, 0.02, 5700, [-0.006, -0.002, -1.3361854e-06, 5.2261757e-10,
                                        -5.0728336e-14, -5.4958195e-07, -4.608942e-11, 2.965907]),
    "radial": (105.0, 0.012, 1024, [1e-3, -1e-5, 1e-8]),
    "hayabusa2": (10.22, 0.013, 1024, [0.013, 1.0, 3.134e-7, -1.716e-13]),
    "ocams": (628.9, 0.0085, 1024, [-0.0894, -0.0027, 0, 6.368e-5, 3.158e-5, 0, 0]),
    "lronac": (699.62, 0.007, 5064, [1.81e-5]),
}  # fmt: skip


def both_ways() -> None:
    print(f"{'both directions':24} {'largest, px':>12}  limit {LIMIT_PX:g}")
    for name, (focal, pixel, size, coefficients) in MODELS.items():
        center = [0.5 + size / 2] * 2
        matrix = [[1 / pixel, 0, 0], [0, 1 / pixel, 0]]
        camera = Camera(focal, center, matrix, size, size, name, coefficients)  # type: ignore[arg-type]
        x, y = np.meshgrid(*[np.linspace(-0.5, 0.5, 101) * size * pixel] * 2)
        back = distort(camera, *undistort(camera, x, y))
        print(f"{name:24} {np.max(np.hypot(back[0] - x, back[1] - y)) / pixel:12.1e}")


def line_scan() -> None:
    lines = 5000
    times = np.linspace(0, 5, lines)
    waves = 2e-5 * np.column_stack([np.sin(9 * times), np.cos(15 * times), np.sin(4 * times)])
    axes = (Rotation.from_rotvec(waves) * Rotation.from_matrix(np.diag([1.0, -1, -1]))).as_matrix()
    places = np.column_stack([0.1 * np.arange(lines), 0.3 * times, 5000 + 2 * times])
    camera = Camera(500.0, [500.5, 1], [[0, 100, 0], [100, 0, 0]], 1000, 1, "lronac", [1e-3])
    scan = LineScan(camera, times, places, axes)
    random = np.random.default_rng(1)
    pixel, line = random.uniform(1, 1000, 100_000), random.uniform(1, lines, 100_000)
    origins, directions = scan_rays(scan, pixel, line)
    start = time.perf_counter()
    seen = project_scan(scan, origins - directions * (origins[:, 2:] / directions[:, 2:]))
    took = time.perf_counter() - start
    worst = max(np.max(np.abs(seen.pixel - pixel)), np.max(np.abs(seen.line - line)))
    print(f"{'line scan with jitter':24} {worst:12.1e}  ({1e5 / took:.0f} points a second)")


def control_points(data: Path) -> None:
    print(f"\n{'LROC NAC control points':24} {'mean, px':>18} {'scatter, px':>16}")
    points = json.loads((data / "moon_lola" / "lidarData.json").read_text())["points"]
    lat, lon = np.radians([[p["latitude"], p["longitude"]] for p in points]).T
    ground = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    ground *= 1e3 * np.array([[p["radius"]] for p in points])
    for number in (0, 1):
        path = data / "moon_lola" / f"lidarObservationImage{number + 1}.isd"
        seen = project_scan(read_isd(path).line_scan(), ground)
        measures = [p["measures"][number] for p in points]
        measured = np.array([[m["sample"], m["line"]] for m in measures])
        miss = np.column_stack([seen.pixel, seen.line]) - measured
        print(f"{path.stem:24} {np.round(miss.mean(axis=0), 3)!s:>18} "
              f"{np.round(miss.std(axis=0), 4)!s:>16}")  # fmt: skip


def star_field(seed: int) -> tuple[list[FloatArray], list[tuple[float, float]], FloatArray]:
    """Return pulls, (unit variance, chi² of the errors), and stars: right, wrong, missed."""
    random = np.random.default_rng(seed)
    tangent = random.uniform(-0.06, 0.06, (400, 2))
    sky = np.column_stack([tangent, np.ones(400)])
    catalogue = StarCatalogue(sky / np.linalg.norm(sky, axis=1, keepdims=True), np.full(400, 7.0))
    matrix = [[117.647, 0.02, 0], [0, -117.7, 0]]
    true = Camera(125.2, [512.5] * 2, matrix, 1024, 1024, "owen", MODELS["owen"][3])
    start = replace(true, focal_length_mm=125.24, distortion=np.zeros(4),
                    k_matrix=np.array([[117.647, 0, 0], [0, -117.647, 0]]))  # fmt: skip
    frames, tally = [], np.zeros(3)
    for number in range(6):
        tilt = Rotation.from_rotvec([*random.normal(scale=0.01, size=2), random.uniform(0, 6)])
        axes = tilt.as_matrix()
        spots = np.column_stack(project_vectors(true, catalogue.directions @ axes.T))
        places = np.flatnonzero(np.all((spots > 3) & (spots < 1022), axis=1))
        places = places[random.uniform(size=len(places)) > 0.2]
        false = random.uniform(1, 1024, (8, 2))
        measured = spots[places] + SIGMA_PX * random.normal(size=(len(places), 2))
        measured = np.concatenate([measured, false])
        covariance = np.broadcast_to(SIGMA_PX**2 * np.eye(2), (len(measured), 2, 2))
        flux = np.full(len(measured), np.nan)
        stars = StarPositions(measured[:, 0], measured[:, 1], covariance, flux)
        about = rotate_axes(axes, random.normal(scale=7e-4, size=3))
        prior = StarFrame(f"S{number}", stars, catalogue.directions[:0], about)
        frame, found = identified_frame(prior, start, catalogue, np.zeros(3))
        truth = np.concatenate([places, np.full(len(false), -1)])
        right = int(np.count_nonzero(truth[found.measured] == found.catalogue))
        tally += [right, len(found.measured) - right, len(places) - right]
        frames.append(frame)
    solved = calibrate(frames, start, solved_parameters(start))
    planted = SolvedParameters(solved.names).value(true)
    miss = solved.estimate - planted
    square = float(miss @ np.linalg.solve(solved.covariance, miss)) / len(miss)
    return [miss / solved.sigma], [(solved.unit_variance, square)], tally


def stars(seeds: int) -> None:
    pulls: list[FloatArray] = []
    units: list[tuple[float, float]] = []
    tally, refused = np.zeros(3), 0
    for seed in range(seeds):
        try:
            pull, unit, counts = star_field(seed)
        except NotObservableError:
            refused += 1
            continue
        pulls, units, tally = pulls + pull, units + unit, tally + counts
    names = ("focal length", "Kxy", "Kyy", "e2", "e4", "e5", "e6")
    print(f"\nstar calibration, {seeds} seeds of 6 images ({refused} refused)")
    print(
        "  std of pulls (1):",
        *(f"{n} {s:.2f}" for n, s in zip(names, np.std(pulls, 0), strict=True)),
    )
    unit, square = np.mean(units, axis=0)
    spread = np.sqrt(2.0 / (len(names) * len(units)))
    print(
        f"  all: {np.std(pulls):.3f}; chi² of the errors / {len(names)} (1): "
        f"{square:.3f} ± {spread:.3f}"
    )
    print(f"  unit variance (1): {unit:.4f}")
    right, wrong, missed = tally
    print(
        f"  identified {right / (right + missed):.4f}, of these wrong {wrong / (right + wrong):.5f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=60)
    parser.add_argument("--data", type=Path)
    options = parser.parse_args()
    both_ways()
    line_scan()
    if options.data:
        control_points(options.data)
    stars(options.seeds)


if __name__ == "__main__":
    main()
