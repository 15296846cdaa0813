"""Whether images fit better with another photometric function than with the one in use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.runtime import Executor, Progress
from fusion.runtime.remaining import Timed
from fusion.stages.lithos.coarse import coarse_solution
from fusion.stages.lithos.sources import LithosSources
from spcola.arrays import FloatArray
from spcola.photometry.functions import (
    PHOTOMETRIC_FUNCTIONS,
    PhotometricFunction,
    lambert,
    lommel_seeliger,
    lunar_lambert,
)

# They darken towards the limb from not at all to most; others lie between.
_FUNCTIONS = (lommel_seeliger, lunar_lambert, lambert)
# Maplets that are compared, evenly chosen, and fewest of them; fewest images of each.
_MAPLETS, _FEWEST_MAPLETS, _FEWEST_IMAGES = 9, 3, 4
# Another function is better where its residual is below this part of that of the one in use, in the
# median, and smaller in this share of the maplets. With the right one (lunar-lambert) others are at
# 1.02 and above on `mini`, `bennu` and 67P; with Lambert's, which makes heights of `mini` 4.5 times
# worse, the best is at 0.86, 0.90 and 0.62.
_BETTER, _SHARE = 0.95, 0.7


@dataclass(frozen=True, eq=False)
class OtherFunctions:
    """Residuals of brightness with other photometric functions, over those with the one in use.

    Parameters
    ----------
    maplets : tuple of str
    ratios : dict of str to ndarray
        By the name of the function: of each maplet.
    """

    maplets: tuple[str, ...]
    ratios: dict[str, FloatArray]

    @classmethod
    def compared(
        cls, sources: LithosSources, names: Sequence[str], executor: Executor, progress: Progress
    ) -> OtherFunctions:
        """Solve some of the maplets on a coarse grid with each function.

        Parameters
        ----------
        sources : LithosSources
        names : sequence of str
            Of the maplets that are solved. Of fewer than three none are compared.
        executor : Executor
        progress : Progress
        """
        shown = [name for name in names if len(sources.showing(name)) >= _FEWEST_IMAGES]
        chosen = shown[:: -(-len(shown) // _MAPLETS) or 1]
        if len(chosen) < _FEWEST_MAPLETS:
            return cls((), {})
        used = sources.options.photoclinometry.function
        functions = [used, *_others(used)]
        asked = [_Asked(name, one) for name in chosen for one in functions]
        label = "maplets with other photometric functions"
        with progress.items(label, [1.0] * len(asked), executor.workers) as task:
            found = list[float]()
            for residual, spent in executor.stream(Timed(_Residual(sources)), asked):
                task.advance_one(spent)
                found.append(residual)
        residuals = np.reshape(found, (len(chosen), len(functions)))
        known = np.isfinite(residuals).all(axis=1)
        ratios = residuals[known, 1:] / residuals[known, :1]
        return cls(
            tuple(name for name, one in zip(chosen, known, strict=True) if one),
            {one.name: ratios[:, k] for k, one in enumerate(functions[1:])},
        )

    def as_json(self) -> dict[str, float] | None:
        """Return the median ratio by function; None if too few maplets were compared."""
        if len(self.maplets) < _FEWEST_MAPLETS:
            return None
        return {name: float(np.median(ratios)) for name, ratios in self.ratios.items()}

    def findings(self) -> list[dict[str, Any]]:
        """Return a finding if another function is clearly better."""
        medians = self.as_json() or {}
        better = {
            name: median
            for name, median in medians.items()
            if median < _BETTER and np.mean(self.ratios[name] < 1.0) >= _SHARE
        }
        if not better:
            return []
        best = min(better, key=lambda name: better[name])
        lower = zip(self.maplets, self.ratios[best], strict=True)
        return [
            {
                "code": "photometry-doubtful",
                "names": [name for name, ratio in lower if ratio < 1.0],
                "do": f"their images fit better with {best}: residual of brightness "
                f"{better[best]:.2f} times as large on a coarse grid; with a wrong photometric "
                "function heights, slopes and albedo are wrong: spcola photometry fit, then "
                "--photometry",
            }
        ]


def _others(used: PhotometricFunction) -> list[PhotometricFunction]:
    """Return what a function is compared with: other formulas, and itself as it is by default."""
    usual = PHOTOMETRIC_FUNCTIONS[used.name]
    own = [usual] if usual.values != used.values else []
    return own + [one for one in _FUNCTIONS if one.code is not used.code]


@dataclass(frozen=True)
class _Asked:
    name: str
    function: PhotometricFunction


@dataclass(frozen=True, eq=False)
class _Residual:
    """Solves a maplet on a coarse grid, and returns the residual of brightness."""

    sources: LithosSources

    def __call__(self, asked: _Asked) -> float:
        found = coarse_solution(self.sources, asked.name, asked.function)
        return found.rounds[-1].residual if found is not None and found.rounds else float("nan")
