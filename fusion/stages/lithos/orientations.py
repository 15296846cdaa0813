"""Whether images fit better mirrored or turned: a wrong convention of a camera's axes."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.runtime import Executor, Progress
from fusion.runtime.remaining import Timed
from fusion.scene import Exposures
from fusion.stages.images import Turn
from fusion.stages.lithos.coarse import coarse_images, coarse_solution
from fusion.stages.lithos.fits import Summary, known_median
from fusion.stages.lithos.sources import LithosSources
from spcola.arrays import FloatArray
from spcola.camera import SpcImage

# Median of residuals over the noise of the images of a camera up to which they fit: right ones are
# at 0.8 to 1.0 where light and grid are right, at 1.3 to 3.7 in real missions (67P, Vesta), and
# turned ones at 1.6 and more.
_FITS = 1.1
# Most maplets that are compared, evenly chosen; fewest images of one; most cameras.
_MAPLETS, _IMAGES, _CAMERAS = 5, 2, 2
# Maplets that are compared first, and ratio of the residuals on these below which an orientation is
# promising: without one the others are not compared, which saves most of the time.
_FIRST, _PROMISING = 2, 0.8
# Another orientation is better where its residual is below the first part of that of the images as
# they are, in the geometric mean over the maplets, smaller in this share of them, below the last
# part of that of the next one, and correlates so much. Of right images (67P, Vesta, the Moon, small
# missions) all others are at 1.2 to 20 of a maplet, and right ones correlate by 0.85 to 1.0.
_BETTER, _SHARE, _DISTINCT, _CORRELATED = 0.6, 0.7, 0.85, 0.8
# Turned by half a turn, images in which ground is seen from above show its hills as hollows, and
# fit as well: both are named where one is within this factor of the other.
_ALIKE = 1.2
_HALF_TURNED = {
    Turn.AS_STORED: Turn.HALF_TURN,
    Turn.MIRRORED_SAMPLES: Turn.MIRRORED_LINES,
    Turn.TRANSPOSED: Turn.ANTI_TRANSPOSED,
    Turn.QUARTER_TURN_RIGHT: Turn.QUARTER_TURN_LEFT,
}
_HALF_TURNED |= {other: one for one, other in _HALF_TURNED.items()}

_Camera = tuple[tuple[int, int], str]
_Cameras = tuple[_Camera, ...]
_Fits = Mapping[str, tuple[float, float]]
"""Logarithm of the residual, and correlation, by the names of images on a maplet."""
_AllFits = dict[_Cameras, dict[Turn, list[_Fits]]]
"""Of each maplet that was compared, by the cameras whose images were turned, and how."""


def orientation_findings(
    sources: LithosSources,
    found: Mapping[str, Summary],
    executor: Executor,
    progress: Progress,
) -> Iterator[dict[str, Any]]:
    """Yield the images of cameras that fit clearly better mirrored or turned, if there are any.

    Some of the maplets are solved on a coarse grid with the images of a camera in each orientation,
    but only where images are left over more than their noise.

    Parameters
    ----------
    sources : LithosSources
    found : mapping of str to Summary
        By the names of the maplets that were solved.
    executor : Executor
    progress : Progress
    """
    every = {image.name: image for name in found for image in sources.showing(name)}
    if _fit_as_they_are(found, every):
        return
    shown = [name for name in found if len(coarse_images(sources, name)) >= _IMAGES]
    chosen = shown[:: -(-len(shown) // _MAPLETS) or 1]
    groups = _groups(image for name in chosen for image in coarse_images(sources, name))
    first = chosen[1::2][:_FIRST] or chosen
    rest = [name for name in chosen if name not in first]
    fits: _AllFits = defaultdict(lambda: defaultdict(list))
    _compare(fits, sources, list(_asked(first, groups)), executor, progress)
    if rest and _is_promising(fits, every):
        _compare(fits, sources, list(_asked(rest, groups)), executor, progress)
    if better := _best_mending(fits, every):
        cameras, compared = better
        names = sorted(name for name, image in every.items() if _camera(image) in cameras)
        yield {"code": "image-orientation", "names": names, "do": compared.text}


def _compare(
    fits: _AllFits,
    sources: LithosSources,
    asked: Sequence[_Asked],
    executor: Executor,
    progress: Progress,
) -> None:
    """Solve maplets with turned images, and add how these fit."""
    label = "maplets with images in other orientations"
    with progress.items(label, [1.0] * len(asked), executor.workers) as task:
        results = executor.stream(Timed(_Turned(sources)), asked)
        for one, (fit, spent) in zip(asked, results, strict=True):
            task.advance_one(spent)
            fits[one.cameras][one.turn].append(fit)


def _is_promising(fits: _AllFits, images: Mapping[str, SpcImage]) -> bool:
    """Whether the images of some cameras fit better in another orientation."""
    compared = (one for _, one in _comparisons(fits, images))
    return any(one.ratio_of(one.best) < _PROMISING for one in compared)


def _comparisons(
    fits: _AllFits, images: Mapping[str, SpcImage]
) -> Iterator[tuple[_Cameras, _Compared]]:
    """Yield how the images of each group of cameras fit in each orientation."""
    for cameras, turns in fits.items():
        own = {name for name, image in images.items() if _camera(image) in cameras}
        yield cameras, _Compared.of({**fits[()], **turns}, own)


def _fit_as_they_are(found: Mapping[str, Summary], images: Mapping[str, SpcImage]) -> bool:
    """Whether the residuals of the images of each camera are not above their noise."""
    ratios = defaultdict[_Camera, list[float]](list)
    for one in found.values():
        for fit in one.images:
            if fit.name in images and fit.noise > 0.0:
                ratios[_camera(images[fit.name])].append(fit.residual / fit.noise)
    medians = [known_median(own) for own in ratios.values()]
    return all(median is None or median <= _FITS for median in medians)


def _best_mending(
    fits: _AllFits, images: Mapping[str, SpcImage]
) -> tuple[_Cameras, _Compared] | None:
    """Return the cameras whose images are clearly better turned, if any, and how they compare.

    If several are, those with which all images fit best.
    """
    clear = dict[_Cameras, tuple[float, _Compared]]()
    for cameras, compared in _comparisons(fits, images):
        if compared.is_clear:
            total = _Compared.of({**fits[()], **fits[cameras]}, set(images))
            clear[cameras] = total.ratio_of(compared.best), compared
    if not clear:
        return None
    cameras = min(clear, key=lambda one: clear[one][0])
    return cameras, clear[cameras][1]


@dataclass(frozen=True)
class _Asked:
    """A maplet to be solved with the images of some cameras in an orientation."""

    maplet: str
    cameras: _Cameras
    turn: Turn


def _groups(images: Iterable[SpcImage]) -> list[_Cameras]:
    """Return the cameras whose images are turned: the usual ones together, and each alone.

    If all cameras have one mistake, mending it for one of them leaves the others wrong.
    """
    usual = [one for one, _ in Counter(map(_camera, images)).most_common(_CAMERAS)]
    several = [tuple(usual)] if len(usual) > 1 else []
    return [*several, *((one,) for one in usual)]


def _asked(names: Sequence[str], groups: Sequence[_Cameras]) -> Iterator[_Asked]:
    """Yield what is to be solved: maplets with images as they are, and with those of each group."""
    for name in names:
        yield _Asked(name, (), Turn.AS_STORED)
    for cameras in groups:
        square = all(width == height for (width, height), _ in cameras)
        for turn in Turn:
            if turn is not Turn.AS_STORED and (square or not turn.exchanges):
                yield from (_Asked(name, cameras, turn) for name in names)


@dataclass(frozen=True, eq=False)
class _Turned:
    """Solves a maplet on a coarse grid with images in another orientation."""

    sources: LithosSources

    def __call__(self, asked: _Asked) -> _Fits:
        sources = self.sources
        turned = {
            image.name: asked.turn.orientation
            for image in coarse_images(sources, asked.maplet)
            if _camera(image) in asked.cameras
        }
        exposed = Exposures(sources.workspace, turned)
        sources = replace(sources, images=replace(sources.images, exposed=exposed))
        function = sources.options.photoclinometry.function
        found = coarse_solution(sources, asked.maplet, function)
        if found is None or not found.rounds:
            return {}
        return {
            fit.name: (float(np.log(fit.residual)), fit.correlation)
            for fit in found.images
            if fit.residual > 0.0
        }


@dataclass(frozen=True, eq=False)
class _Compared:
    """Residuals of maplets with images in other orientations, over those with them as they are.

    Parameters
    ----------
    logs : dict of Turn to ndarray
        Logarithms of the ratios of the maplets.
    correlations : dict of Turn to float
        Medians over images and maplets.
    """

    logs: dict[Turn, FloatArray]
    correlations: dict[Turn, float]

    @classmethod
    def of(cls, fits: Mapping[Turn, Sequence[_Fits]], names: Set[str]) -> _Compared:
        """Compare images of these names, on maplets where some have a residual in each turn."""
        logs, usual = dict[Turn, FloatArray](), dict[Turn, float]()
        for turn, maplets in fits.items():
            own = [[one[name] for name in names & one.keys()] for one in maplets]
            logs[turn] = np.array([np.mean([r for r, _ in one]) if one else np.nan for one in own])
            usual[turn] = known_median(c for one in own for _, c in one) or 0.0
        known = np.isfinite(list(logs.values())).all(axis=0)
        before = logs[Turn.AS_STORED][known]
        return cls({turn: one[known] - before for turn, one in logs.items()}, usual)

    @property
    def best(self) -> Turn:
        """In which they fit best."""
        return min(self.logs, key=self._mean)

    def ratio_of(self, turn: Turn) -> float:
        """Return the residual in an orientation over that of the images as they are."""
        return float(np.exp(self._mean(turn)))

    @property
    def is_clear(self) -> bool:
        """Whether another orientation is clearly better than all others."""
        best = self.best
        if best is Turn.AS_STORED or not self.logs[best].size:
            return False
        others = [self._mean(turn) for turn in self.logs if turn not in (best, _HALF_TURNED[best])]
        return (
            self.ratio_of(best) < _BETTER
            and float(np.mean(self.logs[best] < 0.0)) >= _SHARE
            and self._mean(best) < min(others, default=0.0) + np.log(_DISTINCT)
            and self.correlations[best] >= _CORRELATED
        )

    @property
    def text(self) -> str:
        """What fits better, and what to do."""
        best = self.best
        other = _HALF_TURNED[best]
        alike = self._mean(other) < self._mean(best) + np.log(_ALIKE)
        words = f"{best}{f' or {other}' if alike else ''}"
        if best is Turn.HALF_TURN:
            words += ", or with all Suns on the other side"
        return (
            f"their brightness fits better {words}: residual {self.ratio_of(best):.2f} times as "
            "large on a coarse grid; heights are wrong: bring their pixels again: "
            f"spcola images --orientation {best}, or mend axes and K matrix in their .SUM"
        )

    def _mean(self, turn: Turn) -> float:
        """Return the mean logarithm of the ratios; 0 where none is known."""
        logs = self.logs[turn]
        return float(logs.mean()) if logs.size else 0.0


def _camera(image: SpcImage) -> _Camera:
    """Return what images of one camera share: its size, and about its focal length."""
    return image.size, f"{image.camera.focal_length_mm:.3g}"
