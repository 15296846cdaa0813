"""Errors of estimates over their sigmas, case by case, and their rms over missions."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray


@dataclass(frozen=True)
class Part:
    """Components of an estimate that have one unit, and the rms error that is aimed at."""

    where: slice
    unit: str
    bar: float


@dataclass(frozen=True)
class Row:
    """Errors and sigmas of an estimate, in the units of its parts."""

    error: FloatArray
    sigma: FloatArray


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def print_cases(
    parts: Mapping[str, Part],
    rows_of: Callable[[Path, Path, argparse.Namespace], Iterable[tuple[str, Row]]],
    parser: argparse.ArgumentParser,
) -> None:
    """Print a table for each MISSION=WORKSPACE of the command line, and the rms over all.

    Parameters
    ----------
    parts : mapping of str to Part
    rows_of : callable
        Gives names and rows of one mission and its workspace, with the options.
    parser : ArgumentParser
        With the options of the command.
    """
    parser.add_argument("cases", nargs="+", help="MISSION=WORKSPACE")
    options = parser.parse_args()
    rows: dict[str, list[Row]] = {}
    for text in options.cases:
        mission, workspace = (Path(part) for part in text.split("=", 1))
        print(f"{mission}: {', '.join(f'{name} {part.unit}' for name, part in parts.items())}")
        for name, row in rows_of(mission, workspace, options):
            rows.setdefault(name, []).append(row)
            print(f"  {name:18}{_shown(row.error, parts)}   error / sigma", flush=True)
            pulls = " ".join(f"{pull:+5.2f}" for pull in row.error / row.sigma)
            print(f"  {'':18}{_shown(row.sigma, parts)}   {pulls}", flush=True)
    heads = [f"{name}, {part.unit}" for name, part in parts.items()]
    print(f"\n{'rms over missions':18}" + "".join(f"{head:>28}" for head in heads))
    for name, found in rows.items():
        cells = []
        for part in parts.values():
            error = rms(np.array([row.error[part.where] for row in found]))
            sigma = rms(np.array([row.sigma[part.where] for row in found]))
            cells.append(f"{error:.2f} (sigma {sigma:.2f})")
        print(f"{name:18}" + "".join(f"{cell:>28}" for cell in cells))
    print(f"{'bar':18}" + "".join(f"{part.bar:>28.2f}" for part in parts.values()))


def _shown(values: FloatArray, parts: Mapping[str, Part]) -> str:
    return "   ".join(
        " ".join(f"{value:+7.2f}" for value in values[part.where]) for part in parts.values()
    )
