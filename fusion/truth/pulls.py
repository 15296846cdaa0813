"""Pulls over many missions: whether the stated sigmas are correct."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, kurtosis

from fusion.report.planted import RecoveredParameter

CONFIDENCE = 0.95
"""Confidence of the interval of a standard deviation."""


@dataclass(frozen=True)
class PullStatistics:
    """Errors of one parameter over N missions.

    Attributes
    ----------
    name, unit : str
    count : int
        Missions that recovered the parameter with a sigma.
    missing : int
        Missions that did not recover it.
    mean, mean_sigma : float
        Mean of the pulls (recovered − planted) / sigma, and its standard error from their scatter.
    scatter : float
        Standard deviation of the pulls about their mean (N − 1); NaN of a single mission.
    deviation, lowest, highest : float
        Root mean square of the pulls about **zero**, which includes a bias, and the interval that
        contains the true one at :data:`CONFIDENCE` if the pulls are normal.
    error, sigma : float
        Root mean squares of recovered − planted and of the stated sigmas, in `unit`.
    kurtosis : float
        Excess kurtosis of the pulls about their mean (Joanes & Gill 1998, G2): 0 for normal pulls,
        with a standard error of about √(24/N); above 0 large pulls are more frequent. NaN from
        fewer than four missions.
    """

    name: str
    unit: str
    count: int
    missing: int
    mean: float
    mean_sigma: float
    scatter: float
    deviation: float
    lowest: float
    highest: float
    error: float
    sigma: float
    kurtosis: float


def pull_statistics(missions: Sequence[Sequence[RecoveredParameter]]) -> list[PullStatistics]:
    """Return the statistics of every parameter in the tables of the missions.

    Parameters
    ----------
    missions : sequence of sequences of RecoveredParameter
        One table for each mission.

    Returns
    -------
    list of PullStatistics
        In the order in which the names first appear.
    """
    tables = [{row.name: row for row in rows} for rows in missions]
    names = dict.fromkeys(name for table in tables for name in table)
    return [_statistics(name, tables) for name in names]


def _statistics(name: str, tables: Sequence[Mapping[str, RecoveredParameter]]) -> PullStatistics:
    rows = [table[name] for table in tables if name in table]
    found = [row for row in rows if np.isfinite(row.pull)]
    missing = len(tables) - len(found)
    if not found:
        return PullStatistics(name, rows[0].unit, 0, missing, *[float("nan")] * 9)
    pulls = np.array([row.pull for row in found])
    errors = np.array([row.recovered - row.planted for row in found])
    sigmas = np.array([row.sigma for row in found])
    count = len(pulls)
    deviation = float(np.sqrt(np.mean(pulls**2)))
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = (deviation * np.sqrt(count / chi2.ppf(p, count)) for p in (1.0 - tail, tail))
    scatter = float(np.std(pulls, ddof=1)) if count > 1 else float("nan")
    return PullStatistics(
        name, rows[0].unit, count, missing, float(np.mean(pulls)),
        scatter / float(np.sqrt(count)), scatter, deviation, float(low), float(high),
        float(np.sqrt(np.mean(errors**2))), float(np.sqrt(np.mean(sigmas**2))),
        float(kurtosis(pulls, bias=False)) if count > 3 else float("nan"),
    )  # fmt: skip
