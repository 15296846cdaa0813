"""How often correct shots of one track seem to fit better elsewhere, by Monte Carlo.

    python scripts/bench/wrong/tracks.py [--runs 200] [--shots 26 52 200] [--reach 0 3 8]
                                           [--error 1]

Tracks of shots 4 m apart on globes of 100 m with 2 m of relief in waves of some 30 m; errors
of `error` metres, correlated along the track as exp(-x²/(2 reach²)), x and reach in shots (0:
white). Every run has another track and other errors; ten runs share a body. Printed are the shares
of runs with a better place by the test of paired variances alone, and by both tests, and of those
with rival places.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.ndimage import gaussian_filter1d

from fusion.scaling.fit import ScaleOptions
from fusion.scaling.misplacement import check_place
from fusion.scaling.misplacement.check import FALSE_ALARM
from fusion.scaling.misplacement.significance import LARGER
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.shape import Mesh, RayCaster

RADIUS, RELIEF, SPACING, STEPS, TERMS = 100.0, 2.0, 4.0, 60, 60
PER_BODY = 10


def globe(generator: np.random.Generator) -> Mesh:
    """A globe with waves of some 30 m in all directions."""
    height, around = np.linspace(-1, 1, STEPS + 1)[1:-1], np.arange(2 * STEPS) * np.pi / STEPS
    z, angle = np.repeat(height, 2 * STEPS), np.tile(around, STEPS - 1)
    ring = np.sqrt(1.0 - z**2)
    away = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    away = np.vstack([away, [[0, 0, -1.0], [0, 0, 1.0]]])
    waves = 20.0 * generator.normal(size=(TERMS, 3)) / np.sqrt(3.0)
    bumps = np.cos(away @ waves.T + generator.uniform(0, 2 * np.pi, TERMS)).sum(axis=1)
    rows, columns = np.meshgrid(np.arange(STEPS - 2), np.arange(2 * STEPS), indexing="ij")
    a = (rows * 2 * STEPS + columns).ravel()
    b = (rows * 2 * STEPS + (columns + 1) % (2 * STEPS)).ravel()
    up = 2 * STEPS
    low, top = np.arange(up), np.arange(up) + (STEPS - 2) * up
    facets = [
        np.stack([a, b, b + up], 1),
        np.stack([a, b + up, a + up], 1),
        np.stack([np.roll(low, -1), low, np.full(up, len(away) - 2)], 1),
        np.stack([top, np.roll(top, -1), np.full(up, len(away) - 1)], 1),
    ]
    radius = RADIUS + RELIEF * bumps * np.sqrt(2.0 / TERMS)
    return Mesh(radius[:, None] * away, np.concatenate(facets))


def track(body: RayCaster, error: FloatArray, generator: np.random.Generator) -> Scan:
    """Shots along a great circle in a random plane, with their errors (N,), metres."""
    first, second, _ = np.linalg.qr(generator.normal(size=(3, 3)))[0].T
    angle = (SPACING / RADIUS * np.arange(len(error)))[:, None]
    away = np.cos(angle) * first + np.sin(angle) * second
    distance = body.cast(1000.0 * away, -away).distance + error
    return Scan.of_points("T", (1000.0 - distance[:, None]) * away, spacecraft=1000.0 * away)


def errors(count: int, reach: float, generator: np.random.Generator) -> FloatArray:
    """Errors (count,) of variance 1."""
    white = generator.normal(size=count + 200)
    if reach:
        # A Gaussian kernel gives a correlation wider than itself by the root of 2.
        width = reach / np.sqrt(2.0)
        white = gaussian_filter1d(white, width) * np.sqrt(2.0 * np.sqrt(np.pi) * width)
    return white[100 : 100 + count]


def alarms(count: int, reach: float, size: float, runs: int) -> FloatArray:
    """Return for each run (runs, 3): alarm by paired variances, by both tests, rival places."""
    generator = np.random.default_rng([count, int(reach)])
    found = []
    for run in range(runs):
        if run % PER_BODY == 0:
            body = RayCaster(globe(generator))
        scan = track(body, size * errors(count, reach, generator), generator)
        check = check_place(scan, body, prior=ScaleOptions().prior)
        larger = not check.here_m <= LARGER * check.best_m
        found.append([check.paired < FALSE_ALARM and larger, check.misfit, check.by_chance])
    return np.array(found, dtype=float)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--shots", type=int, nargs="+", default=[26, 52, 200])
    parser.add_argument("--reach", type=float, nargs="+", default=[0.0, 3.0, 8.0])
    parser.add_argument("--error", type=float, default=1.0)
    options = parser.parse_args()
    print("| shots | reach | runs | paired alone | both | rivals |\n|---|---|---|---|---|---|")
    for count in options.shots:
        for reach in options.reach:
            shares = alarms(count, reach, options.error, options.runs).mean(axis=0)
            cells = " | ".join(f"{share:.3f}" for share in shares)
            print(f"| {count} | {reach:g} | {options.runs} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
