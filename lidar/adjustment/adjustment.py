"""Errors of whole scans: rigid displacements solved from all overlaps together.

The errors of spacecraft position and pointing hardly change during one scan, so that a scan is
displaced and rotated as a whole. Overlaps determine the displacements up to those that all scans
share (:mod:`lidar.adjustment.overlaps`); a prior, whose size is estimated too, constrains the rest.
The result has a covariance over all scans: small between scans that overlap, as large as the prior
between those that do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lidar.adjustment.arcs import ScanErrorSizes, columns
from lidar.adjustment.normal_equations import solve_network
from lidar.adjustment.overlaps import COMPONENTS, OverlapEquations
from lidar.adjustment.values import AdjustmentOptions, ScanAdjustment
from spcola.arrays import FloatArray

# A displacement has six numbers. Overlaps of fewer than twice as many cells may be met by chance,
# such as by outliers.
_FEWEST_CELLS = 12
# Eigenvalues of scaled normal equations below this share of the largest are rounding errors.
_ROUNDING = 1e-10
# An overlap contradicts the others when it departs from them by so many standard deviations.
_CONTRADICTED = 5.0
# Most rounds of deciding which of the doubtful overlaps are used.
_MOST_SORTINGS = 10


def adjust_scans(
    before: ScanAdjustment,
    equations: Sequence[OverlapEquations],
    *,
    options: AdjustmentOptions | None = None,
) -> ScanAdjustment:
    """Solve the displacements of all scans from their overlaps.

    The equations are those of returns that `before` has corrected; its displacements are added.
    The sizes of the errors are estimated with them
    (:func:`lidar.adjustment.normal_equations.solve_network`). An overlap of a few cells, or one
    that no displacement makes agree, may consist of outliers, and a single one can rotate scans
    without other constraints: it is used only if the others do not contradict it. Where the
    overlaps fit worse than their noise predicts, the covariance grows with the misfit.

    Parameters
    ----------
    before : ScanAdjustment
        Result of the last round, or :meth:`ScanAdjustment.unadjusted`.
    equations : sequence of OverlapEquations
    options : AdjustmentOptions, optional
    """
    options = options or AdjustmentOptions()
    sound = [part for part in equations if _is_conclusive(part)]
    doubtful = [part for part in equations if not _is_conclusive(part)]
    used = np.zeros(len(doubtful), dtype=np.bool_)
    start = before.sizes if options.estimate else options.sizes
    for _ in range(_MOST_SORTINGS):
        weighted = [p if b else _with_weight_zero(p) for p, b in zip(doubtful, used, strict=True)]
        found = _adjusted(before, [*sound, *weighted], options, start)
        start = found.sizes
        ratio = np.array([_departure(part, before, found) for part in doubtful])
        # Where no overlap is conclusive, as among tracks, they are compared with each other.
        many = not sound and len(doubtful) >= _FEWEST_CELLS
        usual = max(float(np.median(ratio)), 1.0) if many else 1.0
        agreeing = ratio <= _CONTRADICTED**2 * usual
        if np.array_equal(agreeing, used):
            break
        used = agreeing
    return found


def _is_conclusive(part: OverlapEquations) -> bool:
    """Return whether an overlap shows by itself that its scans cover the same ground.

    It does if they meet in many cells, and some displacement makes them agree there.
    """
    if part.cells.max() < _FEWEST_CELLS:
        return False
    return _least_energy(part)[0] <= _CONTRADICTED**2 * float(part.freedom.sum())


def _least_energy(part: OverlapEquations) -> tuple[float, float]:
    """Energy of an overlap after its best displacement, and the degrees of freedom."""
    inverse, rank = _inverse(part.normal)
    left = float(part.chi2.sum() - part.right @ inverse @ part.right)
    return left, float(part.freedom.sum()) - rank


def _excess(parts: Sequence[OverlapEquations]) -> float:
    """Factor by which variances are too small, at least 1: that of the median overlap.

    The median, so that one overlap that fits nowhere does not increase all variances.
    """
    energies = [_least_energy(part) for part in parts if part.weight > 0]
    ratio = [left / free for left, free in energies if free >= _FEWEST_CELLS]
    return max(float(np.median(ratio)), 1.0) if ratio else 1.0


def _with_weight_zero(part: OverlapEquations) -> OverlapEquations:
    """Return an overlap with weight 0; with many cells it still counts in the misfit."""
    nothing = np.zeros(len(part.scan))
    kept = (part.cells, part.chi2, part.freedom)
    if part.cells.max() < _FEWEST_CELLS:
        kept = (nothing, nothing, nothing)
    still, right = np.zeros_like(part.normal), np.zeros_like(part.right)
    return OverlapEquations(part.scan, still, right, *kept, weight=0.0)


def _departure(part: OverlapEquations, before: ScanAdjustment, found: ScanAdjustment) -> float:
    """Energy of an overlap after `found`, relative to its expectation from noise and covariance."""
    at = columns(part.scan)
    step = (found.displacement - before.displacement).ravel()[at]
    energy = float(part.chi2.sum() - 2.0 * part.right @ step + step @ part.normal @ step)
    unknown = float(np.sum(part.normal * found.covariance[np.ix_(at, at)]))
    return energy / (float(part.freedom.sum()) + unknown)


def _adjusted(
    before: ScanAdjustment,
    equations: Sequence[OverlapEquations],
    options: AdjustmentOptions,
    start: ScanErrorSizes,
) -> ScanAdjustment:
    """Solve the displacements from weighted overlaps; the search for sizes begins at `start`."""
    count = len(before)
    cells, chi2, freedom = np.zeros(count), np.zeros(count), np.zeros(count)
    former = before.displacement.ravel()
    whole = []
    for part in equations:
        cells[part.scan] += part.cells
        chi2[part.scan] += part.chi2
        freedom[part.scan] += part.freedom
        # Departures from the others, relative to the whole displacement and not to its last step.
        right = part.right + part.normal @ former[columns(part.scan)]
        whole.append(replace(part, right=right))
    few = cells < _FEWEST_CELLS
    with np.errstate(invalid="ignore", divide="ignore"):
        misfit = np.sqrt(chi2 / np.where((freedom > 0) & ~few, freedom, np.nan))
    found = solve_network(
        whole,
        before.arcs,
        options.sizes,
        start=start,
        excess=_excess(equations),
        estimate=options.estimate,
    )
    return ScanAdjustment(
        before.names,
        before.arcs,
        found.displacement.reshape(count, COMPONENTS),
        found.covariance,
        found.sizes,
        misfit,
        cells,
        _moved(equations, found.displacement - former),
    )


def _moved(equations: Sequence[OverlapEquations], step: FloatArray) -> float:
    """Rms change by a `step` (6S,) of the height differences between scans, metres."""
    weight = sum(part.weight for part in equations)
    energy = sum(
        float(step[at] @ part.normal @ step[at])
        for part in equations
        if len(at := columns(part.scan))
    )
    return float(np.sqrt(max(energy, 0.0) / weight)) if weight > 0 else 0.0


def _inverse(normal: FloatArray) -> tuple[FloatArray, int]:
    """Pseudo-inverse of normal equations of displacements, and their rank."""
    # Metres and radians have different scales; the smallest eigenvalues are rounding errors.
    unit = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal * np.outer(unit, unit))
    observable = values > _ROUNDING * max(float(values[-1]), 0.0)
    root = unit[:, None] * vectors[:, observable] / np.sqrt(values[observable])
    return root @ root.T, int(np.count_nonzero(observable))
