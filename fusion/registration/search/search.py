"""Search for the rotation, mirrored axis, unit and shift by which a wrong lidar frame fits SPC."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.registration.search.closest import Placement, PointSurface, fit_placement
from fusion.registration.search.directions import Directions, cell_centers
from fusion.registration.search.frame_texts import UNITS, FrameChange, frame_change
from fusion.registration.search.highpass import ShortRelief
from fusion.registration.search.orientations import (
    all_orientations,
    apart_deg,
    distinct,
    likeness,
    refined,
)
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

_ORIENTATIONS = 30_000
_COARSE_DEG, _MIDDLE_DEG = 5.0, 2.0
_COARSE_LIDAR, _COARSE_SURFACE, _FINE = 12, 32, 64
_TRIED, _FITTED = 250, 48
_FEW, _SOME, _MANY = 1000, 3000, 20_000
_FEW_STEPS, _MANY_STEPS = 10, 30
# Orientations nearer to the best than the second angle do not count as wrong places.
_APART_DEG, _ELSEWHERE_DEG = 4.0, 20.0
_LEAST_POINTS = 30
_ELSEWHERE, _LEAST_WRONG = 120, 20
LEAST_SIGNIFICANCE = 5.0
"""Smallest margin above all wrong places, in their standard deviations, of a valid result."""
LEAST_CORRELATION = 0.4
"""Smallest correlation of the short-wave relief of lidar and surface of a valid result."""


@dataclass(frozen=True, eq=False)
class FrameCandidate:
    """A placement of the lidar on the SPC surface.

    Attributes
    ----------
    placement : Placement
        Takes lidar coordinates to SPC coordinates, metres.
    change : FrameChange
        The same in words.
    correlation : float
        Of the relief at wavelengths below some twenty degrees, −1 to 1.
    misfit_m : float
        Robust standard deviation of the lidar's distances from the surface, metres.
    share : float
        Share of the lidar where there is a surface.
    """

    placement: Placement
    change: FrameChange
    correlation: float
    misfit_m: float
    share: float

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types."""
        return {
            **self.change.as_json(),
            "matrix": self.placement.matrix.tolist(),
            "scale": self.placement.scale,
            "translation_m": self.placement.translation.tolist(),
            "correlation": self.correlation,
            "misfit_m": self.misfit_m,
            "share": self.share,
        }


@dataclass(frozen=True, eq=False)
class FrameSearch:
    """Result of a search for the lidar's frame.

    Attributes
    ----------
    candidates : tuple of FrameCandidate
        By decreasing correlation of their relief.
    found : bool
        Whether the first candidate is significant; all others are wrong places.
    significance : float
        Margin of the first above all wrong places, in their standard deviations.
    """

    candidates: tuple[FrameCandidate, ...]
    found: bool
    significance: float

    @property
    def best(self) -> FrameCandidate | None:
        """The significant placement; None if there is none."""
        return self.candidates[0] if self.found else None

    @property
    def text(self) -> str:
        """The result in one clause."""
        if self.found:
            return f"the lidar {self.candidates[0].change.text}"
        return (
            "no rotation, mirrored axis, unit or shift makes the lidar fit: it may be of another "
            "body, or have no relief"
        )

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types, with the best candidate and the next four."""
        return {
            "found": self.found,
            "text": self.text,
            "significance": self.significance,
            "candidates": [candidate.as_json() for candidate in self.candidates[:5]],
        }


def search_frames(lidar: FloatArray, surface: FloatArray) -> FrameSearch:
    """Search for the rotation, mirrored axis, unit, scale and shift by which lidar fits a surface.

    All orientations, mirrored ones included, are compared by the radii of both surfaces as
    functions of direction. The best are refined, and fitted by distances from the surface. The
    result is accepted only if its short-wave relief, on which the fit of the long-wave shape does
    not depend, correlates far better than at the wrong places where other fits ended.

    Parameters
    ----------
    lidar : (N, 3) ndarray
        Returns, body-fixed, over all of the lidar's coverage; metres if their unit is right. Some
        ten thousand are enough; more than a million take longer.
    surface : (M, 3) ndarray
        Points of the SPC surface, metres, spaced by less than a degree from the body's centre.

    Returns
    -------
    FrameSearch

    Raises
    ------
    NotObservableError
        If lidar or surface have too few points.
    """
    search = _Search(lidar, surface, np.random.default_rng(1))
    fitted = [search.fitted(start, search.few, _FEW_STEPS) for start in search.starts()]
    fitted = [candidate for candidate in fitted if np.isfinite(candidate.misfit_m)]
    if not fitted:
        return FrameSearch((), False, 0.0)
    fitted.sort(key=lambda candidate: -candidate.correlation)
    best = search.fitted(fitted[0].placement, search.many, _MANY_STEPS)
    matrices = np.array([candidate.placement.matrix for candidate in fitted])
    others = np.flatnonzero(apart_deg(best.placement.matrix, matrices) > _ELSEWHERE_DEG)
    score = np.array([candidate.correlation for candidate in fitted])
    apart = others[distinct(matrices[others], score[others], _APART_DEG, len(others))]
    wrong = np.concatenate([score[apart], search.elsewhere(best)])
    significance = significance_of(best.correlation, wrong)
    found = significance >= LEAST_SIGNIFICANCE and best.correlation >= LEAST_CORRELATION
    return FrameSearch((best, *(fitted[k] for k in apart)), found, significance)


def significance_of(best: float, wrong: FloatArray) -> float:
    """Return the margin of a correlation above all wrong places, in their standard deviations.

    Parameters
    ----------
    best : float
        Correlation at the place tested.
    wrong : (K,) ndarray
        Correlations at wrong places. Their Fisher transforms are nearly normal, so that the best of
        wrong places exceeds the next by less than one standard deviation; even with exponential
        tails, by five in less than one case of a hundred.

    Returns
    -------
    float
        0 if there are too few wrong places.
    """
    if len(wrong) < _LEAST_WRONG:
        return 0.0
    others = _normal(wrong)
    spread = float(np.sqrt(np.mean((others - others.mean()) ** 2)))
    return float((_normal(best) - others.max()) / spread) if spread > 0.0 else 0.0


def _normal(correlation: Any) -> Any:
    """Fisher's transform, which makes correlations by chance nearly normal."""
    return np.arctanh(np.clip(correlation, -0.9999, 0.9999))


class _Search:
    """Both surfaces, prepared for all steps of a search."""

    def __init__(self, lidar: FloatArray, surface: FloatArray, draw: np.random.Generator) -> None:
        self._ground = Directions.of(_finite(surface), _FINE)
        self._lidar = _in_cells(_finite(lidar))
        if len(self._ground) < _LEAST_POINTS or len(self._lidar) < _LEAST_POINTS:
            raise NotObservableError(
                f"{len(self._lidar)} places of the lidar and {len(self._ground)} of the surface "
                f"are too few, {_LEAST_POINTS} are needed",
                where="search for the lidar's frame",
            )
        radius = float(np.exp(np.median(self._ground.log_radius)))
        self._surface = PointSurface(_finite(surface), np.radians(1.0) * radius)
        self._relief = ShortRelief(self._ground)
        order = draw.permutation(len(self._lidar))
        points = _finite(lidar)[self._lidar.row]
        self._order = order[:_FEW]
        self.few, self.some, self.many = (points[order[:count]] for count in (_FEW, _SOME, _MANY))

    def starts(self) -> list[Placement]:
        """The best orientations, each with the scale that makes the median radii equal."""
        ground, lidar = self._ground, self._lidar
        coarse = lidar.coarser(_COARSE_LIDAR)
        score = likeness(
            tried := all_orientations(_ORIENTATIONS),
            coarse.unit,
            lidar.smoothed(coarse.unit, _COARSE_DEG),
            ground.smoothed(cell_centers(_COARSE_SURFACE), _COARSE_DEG),
            tuple(UNITS),
        )
        likely = distinct(tried, score, 8.0, _TRIED)
        unit, log_radius = lidar.unit[self._order], lidar.log_radius[self._order]
        middle = ground.smoothed(cell_centers(_FINE), _MIDDLE_DEG)
        better, score = refined(tried[likely], unit, log_radius, middle, tuple(UNITS))
        chosen = better[distinct(better, score, _APART_DEG, _FITTED)]
        return [self._scaled(matrix, unit, log_radius) for matrix in chosen]

    def _scaled(self, matrix: FloatArray, unit: FloatArray, log_radius: FloatArray) -> Placement:
        _, row = self._ground.tree.query(unit @ matrix.T)
        scale = float(np.exp(np.median(self._ground.log_radius[row] - log_radius)))
        return Placement(matrix, np.zeros(3), scale)

    def fitted(self, start: Placement, points: FloatArray, steps: int) -> FrameCandidate:
        """Fit `points` to the surface from a start, and correlate the short-wave relief."""
        at, misfit, share = fit_placement(self._surface, points, start, steps=steps)
        correlation = self._relief.correlation(at.apply(self.some))
        radius = float(np.exp(np.median(self._ground.log_radius)))
        return FrameCandidate(at, frame_change(at, radius, misfit), correlation, misfit, share)

    def elsewhere(self, best: FrameCandidate) -> FloatArray:
        """Correlations (K,) of the lidar's short-wave relief with the surface's at wrong places."""
        turns = all_orientations(_ELSEWHERE // 2)
        turns = turns[apart_deg(np.eye(3), turns) > _ELSEWHERE_DEG]
        placed = best.placement.apply(self.few)
        found = self._relief.elsewhere(placed, turns)
        return found[np.isfinite(found)]


def _finite(points: FloatArray) -> FloatArray:
    return points[np.isfinite(points).all(axis=1)]


def _in_cells(points: FloatArray) -> Directions:
    """Sort returns into cells, smaller ones if the lidar covers a small part of the body."""
    for n in (_FINE, 2 * _FINE, 4 * _FINE):
        cells = Directions.of(points, n)
        if len(cells) >= _SOME:
            break
    return cells
