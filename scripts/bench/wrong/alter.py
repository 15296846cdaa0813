#!/usr/bin/env python3
"""Lidar files made wrong on purpose: the OLA tables of a folder, altered, in another folder.

    python scripts/bench/wrong/alter.py SOURCE TARGET "turn -90 z" [--seed 1]

Alterations and their arguments (see `WAYS`); several joined by ` + ` are done one after another,
and `one` before an alteration alters one file only:

    turn DEG AXIS     x, y, z, "random" or three numbers: as if the frame were rotated
    mirror AXIS       one axis, x, y or z, with the other sign
    west              longitudes with the other sign
    axes XZY          axes in another order
    unit F            all lengths times F: 0.001 for kilometres where metres are expected
    points F          the points alone times F, not range and spacecraft
    scale F           a body larger by the factor F, seen from the same places
    shift X Y Z       metres
    cloud             points at random around the body
    shuffle           each point with the distance from the centre of another point of its file
    times             records with the times of others
    clock S           times later by S seconds
    other             another body, as large and as rough, seen along the same directions
    sphere            a sphere, with the noise of ranges
    relief            inverted relief: hollows for hills
    sign              ranges, and points located by them, with the other sign
    noise M           ranges with more noise, of M metres
    bias M            ranges longer by M metres
    drift M           ranges longer by 0 at the beginning of a file to M metres at its end
    outliers SHARE    this share of the returns at random heights
    half              nothing south of the equator
    none              the same

All records remain self-consistent (x, y, z with longitude, latitude, radius and with range and
spacecraft), except for `points` and `sign`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidar.formats.missions import OLA_RECORD

Table = NDArray[Any]
Floats = NDArray[np.float64]

RANGE_NOISE_M = 0.03
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Case:
    """Arguments of an alteration, and the body: median and standard deviation of radii, metres."""

    arguments: Sequence[str]
    draw: np.random.Generator
    middle: float
    spread: float


Way = Callable[[Table, Case], None]


def alter(source: str | Path, target: str | Path, how: str, seed: int = 1) -> list[Path]:
    """Write the OLA tables (.dat) of the folder `source` to the folder `target`, altered.

    Parameters
    ----------
    source, target : path
        `target` is made; files of the same names are replaced.
    how : str
        See the text of the module: ``"turn 90 z"``, ``"mirror x + unit 0.001"``,
        ``"one turn 20 random"``.
    seed : int
        Of all random numbers: one axis and one other body for all files, separate noise for each.

    Returns
    -------
    list of Path
        The files written.
    """
    files = sorted(Path(source).glob("*.dat"))
    if not files:
        raise SystemExit(f"{source}: holds no OLA table (*.dat)")
    Path(target).mkdir(parents=True, exist_ok=True)
    written = []
    radius = np.concatenate([_radius(np.fromfile(file, OLA_RECORD)) for file in files])
    middle, spread = float(np.median(radius)), float(radius.std())
    chosen = int(np.random.default_rng(seed).integers(len(files)))
    for number, file in enumerate(files):
        table = np.fromfile(file, OLA_RECORD)
        for step in (part.split() for part in how.split("+")):
            only_one = step[0] == "one"
            name, *arguments = step[1:] if only_one else step
            if name not in WAYS:
                raise SystemExit(f"{name!r} is none of {', '.join(WAYS)}")
            if not only_one or number == chosen:
                # Common values are drawn from the seed alone, noise from the file's number too.
                shared = name in ("turn", "other")
                draw = np.random.default_rng(seed if shared else (seed, number))
                WAYS[name](table, Case(arguments, draw, middle, spread))
        written.append(Path(target) / file.name)
        table.tofile(written[-1])
    return written


def valid(table: Table) -> NDArray[np.bool_]:
    """Return which records are returns."""
    return table["flag_status"] % 100 == 0


def moved(table: Table, matrix: Floats) -> None:
    """Multiply points and spacecraft by `matrix` (3, 3), which keeps lengths."""
    table["xyz"] = table["xyz"] @ matrix.T
    table["scxyz"] = table["scxyz"] @ matrix.T
    restated(table)


def placed(table: Table, points: Floats) -> None:
    """Move the returns to `points` (N, 3), with the spacecraft unchanged."""
    rows = valid(table)
    offset = _distance(table) - table["range_mm"] * 1e-3
    table["xyz"][rows] = points
    table["range_mm"][rows] = (_distance(table) - offset)[rows] * 1e3
    restated(table)


def restated(table: Table) -> None:
    """Compute longitude, latitude and radius from the points."""
    x, y, z = table["xyz"].T
    radius = np.linalg.norm(table["xyz"], axis=1)
    table["elongitude_deg"] = np.degrees(np.arctan2(y, x)) % 360.0
    table["latitude_deg"] = np.degrees(np.arcsin(np.clip(z / radius, -1.0, 1.0)))
    table["radius_km"] = radius * 1e-3


def turning(angle_deg: float, axis: Sequence[str], draw: np.random.Generator) -> Floats:
    """Rotation matrix (3, 3) of an angle about x, y, z, a random axis or three numbers."""
    if axis[0] == "random":
        direction = draw.normal(size=3)
    elif axis[0] in AXES:
        direction = np.array(AXES[axis[0]])
    else:
        direction = np.array([float(number) for number in axis])
    direction /= np.linalg.norm(direction)
    matrix: Floats = Rotation.from_rotvec(np.radians(angle_deg) * direction).as_matrix()
    return matrix


def other_radius(directions: Floats, middle: float, spread: float, seed: int) -> Floats:
    """Radii (N,), metres, of a random body of a mean radius and a standard deviation of radii."""
    draw = np.random.default_rng(seed)
    count = 240
    wave = draw.normal(size=(count, 3))
    wave /= np.linalg.norm(wave, axis=1, keepdims=True)
    number = np.exp(draw.uniform(np.log(2.0), np.log(40.0), count))
    size, phase = number**-1.0, draw.uniform(0.0, 2.0 * np.pi, count)
    relief = np.zeros(len(directions))
    for k in range(count):
        relief += size[k] * np.cos(number[k] * (directions @ wave[k]) + phase[k])
    return middle + spread * relief / np.sqrt(0.5 * np.sum(size**2))


def _turn(table: Table, case: Case) -> None:
    moved(table, turning(float(case.arguments[0]), case.arguments[1:], case.draw))


def _mirror(table: Table, case: Case) -> None:
    moved(table, np.eye(3) - 2.0 * np.diag(AXES[case.arguments[0]]))


def _west(table: Table, _: Case) -> None:
    moved(table, np.diag([1.0, -1.0, 1.0]))


def _axes(table: Table, case: Case) -> None:
    moved(table, np.array([AXES[axis] for axis in case.arguments[0].lower()]))


def _unit(table: Table, case: Case) -> None:
    factor = float(case.arguments[0])
    for name in ("xyz", "scxyz", "range_mm"):
        table[name] *= factor
    restated(table)


def _points(table: Table, case: Case) -> None:
    table["xyz"] *= float(case.arguments[0])


def _scale(table: Table, case: Case) -> None:
    placed(table, float(case.arguments[0]) * table["xyz"][valid(table)])


def _shift(table: Table, case: Case) -> None:
    by = np.array([float(number) for number in case.arguments])
    table["xyz"] += by
    table["scxyz"] += by
    restated(table)


def _cloud(table: Table, case: Case) -> None:
    radius = _radius(table)
    low, high = np.quantile(radius, [0.001, 0.999])
    directions = _unit_vectors(case.draw.normal(size=(len(radius), 3)))
    placed(table, directions * case.draw.uniform(0.9 * low, 1.1 * high, len(radius))[:, None])


def _shuffle(table: Table, case: Case) -> None:
    placed(table, _directions(table) * case.draw.permutation(_radius(table))[:, None])


def _times(table: Table, case: Case) -> None:
    order = case.draw.permutation(len(table))
    for name in ("et", "utc"):
        table[name] = table[name][order]


def _clock(table: Table, case: Case) -> None:
    table["et"] += float(case.arguments[0])


def _other(table: Table, case: Case) -> None:
    seed, directions = int(case.draw.integers(2**31)), _directions(table)
    relief = other_radius(directions, case.middle, case.spread, seed)
    noise = case.draw.normal(0.0, RANGE_NOISE_M, len(directions))
    placed(table, directions * (np.maximum(relief, 0.2 * case.middle) + noise)[:, None])


def _sphere(table: Table, case: Case) -> None:
    noise = case.draw.normal(0.0, RANGE_NOISE_M, int(valid(table).sum()))
    placed(table, _directions(table) * (case.middle + noise)[:, None])


def _relief(table: Table, case: Case) -> None:
    placed(table, _directions(table) * (2.0 * case.middle - _radius(table))[:, None])


def _sign(table: Table, _: Case) -> None:
    rows = valid(table)
    table["range_mm"][rows] *= -1.0
    table["xyz"][rows] = 2.0 * table["scxyz"][rows] - table["xyz"][rows]
    restated(table)


def _noise(table: Table, case: Case) -> None:
    _lengthened(table, case.draw.normal(0.0, float(case.arguments[0]), len(table)))


def _bias(table: Table, case: Case) -> None:
    _lengthened(table, np.full(len(table), float(case.arguments[0])))


def _drift(table: Table, case: Case) -> None:
    since = table["et"] - table["et"].min()
    _lengthened(table, float(case.arguments[0]) * since / since.max())


def _outliers(table: Table, case: Case) -> None:
    radius = _radius(table)
    off = case.draw.random(len(radius)) < float(case.arguments[0])
    heights = np.where(off, case.draw.uniform(0.7, 1.3, len(radius)) * np.median(radius), radius)
    placed(table, _directions(table) * heights[:, None])


def _half(table: Table, _: Case) -> None:
    south = valid(table) & (table["latitude_deg"] < 0.0)
    table["flag_status"][south] = 103
    table["range_mm"][south] = -1128.92


def _none(table: Table, _: Case) -> None:
    pass


def _lengthened(table: Table, by: Floats) -> None:
    """Lengthen the ranges of the returns by metres (N,), one number for each record."""
    rows = valid(table)
    beam = _unit_vectors(table["xyz"] - table["scxyz"])
    placed(table, (table["xyz"] + by[:, None] * beam)[rows])


def _distance(table: Table) -> Floats:
    distance: Floats = np.linalg.norm(table["xyz"] - table["scxyz"], axis=1)
    return distance


def _radius(table: Table) -> Floats:
    radius: Floats = np.linalg.norm(table["xyz"][valid(table)], axis=1)
    return radius


def _directions(table: Table) -> Floats:
    return _unit_vectors(table["xyz"][valid(table)])


def _unit_vectors(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


WAYS: dict[str, Way] = {
    "turn": _turn, "mirror": _mirror, "west": _west, "axes": _axes, "unit": _unit,
    "points": _points, "scale": _scale, "shift": _shift, "cloud": _cloud, "shuffle": _shuffle,
    "times": _times, "clock": _clock, "other": _other, "sphere": _sphere, "relief": _relief,
    "sign": _sign, "noise": _noise, "bias": _bias, "drift": _drift, "outliers": _outliers,
    "half": _half, "none": _none,
}  # fmt: skip
"""Each alteration by its name; it changes a table in place."""


def main() -> None:
    """Alter the files of a folder by the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("how")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    for path in alter(arguments.source, arguments.target, arguments.how, arguments.seed):
        print(path)


if __name__ == "__main__":
    main()
