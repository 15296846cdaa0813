"""What ``spcola spc lithos`` found: ``photoclinometry.json``, and lines for people."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fusion.runtime.findings import finding_lines
from fusion.stages.lithos.constraint_findings import constraint_findings
from fusion.stages.lithos.outliers import outlier_findings
from spcola.photometry.photoclinometry import Fit, ImageFit, Outcome, Photoclinometry

PHOTOCLINOMETRY_KEYS = {
    "options": "what was asked for",
    "outcomes": "number of maplets by outcome",
    "residual_start": "median over maplets, relative residual of brightness in round one",
    "residual": "the same at the end",
    "shift_m": "goodness of fit of the solution: root mean square over maplets and images of how "
    "far images are shifted, on the ground",
    "maplets[].outcome": "how it ended: converged, not-converged, undetermined, too-few-images, "
    "diverged; the last two keep the start",
    "maplets[].reason": "why it ended so",
    "maplets[].residual_start": "median over images, relative residual of brightness in round one",
    "maplets[].residual": "the same at the end",
    "maplets[].noise_ratio": "median over images, residual over the noise of the image: 1 where "
    "brightness fits as well as it can",
    "maplets[].correlation": "median over images, of expected and observed brightness",
    "maplets[].shift_px": "root mean square over images of their shifts, pixels",
    "maplets[].shift_m": "the same on the ground",
    "maplets[].sigma_m": "median sigma of the heights",
    "maplets[].directions": "shares of cells whose slope images determine in 0, 1, 2 directions",
    "maplets[].light_ratio": "residual of brightness with all Suns on the other side, over "
    "that with them as stated, on the coarsest GSD; median below 0.97: doubtful light",
    "maplets[].rounds": "GSD (m), residual, changes of heights (m) and albedo (rms) of each round",
    "maplets[].constraints": "by constraint: number of heights, number left_out as false before, "
    "robust rms of them less the solved ones (residual_m), and of each over its sigma (ratio): 1 "
    "where sigmas are right and images agree",
    "maplets[].images": "fit, scale λ and its change to the edge, shift (px), residual, noise "
    "(relative), correlation, pixels, and metres a pixel, of each image",
    "images": "over all maplets: number used, median residual, noise_ratio and correlation, root "
    "mean square of the shifts (px, m), maplets by fit",
    "findings": "outliers: code, names, what to do",
}
# Ratio of residuals with all Suns on the other side, and as stated, below which light is doubtful.
_DOUBTFUL_LIGHT = 0.97
# Names in a printed line, and how many of the worst.
_NAMED, _WORST = 5, 3
_MAPLET_CODES = (
    Outcome.TOO_FEW_IMAGES, Outcome.DIVERGED, Outcome.UNDETERMINED, Outcome.NOT_CONVERGED,
)  # fmt: skip
WHAT_TO_DO: Mapping[Outcome | Fit, str] = {
    Outcome.TOO_FEW_IMAGES: "they keep their heights; bring more images of them, with the Sun at "
    "least 20° high, or constrain them: --constraint lidar",
    Outcome.DIVERGED: "they keep their heights; look at their images: spcola look",
    Outcome.UNDETERMINED: "their heights follow the start, and their sigmas are large: "
    "bring images in other light, or constrain them: --constraint lidar",
    Outcome.NOT_CONVERGED: "their heights may be used; go on with more rounds: --rounds",
    Fit.SUN_REVERSED: "the direction of the Sun in their .SUM has a wrong sign: make their states "
    "anew: spcola sumfiles",
    Fit.CONTRADICTS: "they show other ground, or the surface at another time: check their states, "
    "or leave them out",
}


@dataclass(frozen=True)
class LithosResult:
    """A new solution with maplets from images.

    Attributes
    ----------
    solution, parent : str
    folder : Path
    content : mapping
        Of ``photoclinometry.json``.
    """

    solution: str
    parent: str
    folder: Path
    content: Mapping[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``--json``."""
        return {"solution": self.solution, "parent": self.parent, **self.content}

    def lines(self) -> list[str]:
        """Return the lines to print."""
        maplets = self.content["maplets"].values()
        counts = ", ".join(f"{n} {outcome}" for outcome, n in self.content["outcomes"].items())
        solved = [one for one in maplets if one["rounds"]]
        lines = [f"solution {self.solution}, from {self.parent}: {len(maplets)} maplets, {counts}"]
        if solved:
            # Images may show enough ground of a start or of its solution only, and a maplet that
            # diverged keeps its start, which may have no sigma.
            before, after, sigma = (
                _median(one[key] for one in solved)
                for key in ("residual_start", "residual", "sigma_m")
            )
            lines.append(
                f"  residual of brightness {_shown(before, '.1%')} → {_shown(after, '.1%')}, sigma "
                f"of heights {_shown(sigma, '.3f', ' m')} (medians)"
            )
            lines += _worst_lines(self.content)
        lines += finding_lines(self.content["findings"])
        root = self.folder.parent.parent
        return [*lines, f"  for all commands: spcola solution use {root} {self.solution}"]


@dataclass(frozen=True)
class Summary:
    """What is kept in memory of a maplet: not its layers.

    Parameters
    ----------
    outcome : Outcome
    images : tuple of ImageFit
    content : mapping
        In JSON types.
    """

    outcome: Outcome
    images: tuple[ImageFit, ...]
    content: Mapping[str, Any]

    @classmethod
    def of(cls, found: Photoclinometry) -> Summary:
        """Return the summary of a maplet."""
        return cls(found.outcome, found.images, _maplet_json(found))


def content_of(
    found: Mapping[str, Summary], options: Mapping[str, Any], given: Sequence[str]
) -> dict[str, Any]:
    """Return the content of ``photoclinometry.json``.

    Parameters
    ----------
    found : mapping of str to Summary
        By the names of maplets.
    options : mapping
        In JSON types.
    given : sequence of str
        Names of the constraints that do not come from other maplets or the shape.
    """
    by_image: dict[str, list[ImageFit]] = defaultdict(list)
    for one in found.values():
        for fit in one.images:
            by_image[fit.name].append(fit)
    solved = [one.content for one in found.values() if one.content["rounds"]]
    maplets = {name: one.content for name, one in found.items()}
    return {
        "options": dict(options),
        **{key: _median(one[key] for one in solved) for key in ("residual_start", "residual")},
        "shift_m": _goodness([fit for fits in by_image.values() for fit in fits])["shift_m"],
        "outcomes": dict(sorted(Counter(str(one.outcome) for one in found.values()).items())),
        "maplets": maplets,
        "images": {name: image_json(fits) for name, fits in sorted(by_image.items())},
        "findings": [*_findings(found, by_image), *constraint_findings(maplets, given)],
    }


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.median(known)) if known else None


def _shown(value: float | None, form: str, unit: str = "") -> str:
    """Return a number and its unit; unknown stays unknown."""
    return "unknown" if value is None else f"{value:{form}}{unit}"


def _worst_lines(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the maplets whose brightness fits worst, and the images that correlate least."""
    maplets = [
        (-one["residual"], name) for name, one in content["maplets"].items() if one["residual"]
    ]
    images = [
        (one["correlation"], name)
        for name, one in content["images"].items()
        if one["correlation"] is not None
    ]
    for title, values in (("residuals of maplets", maplets), ("correlations of images", images)):
        if len(values) > _NAMED:
            form = "{:.1%}" if values is maplets else "{:.2f}"
            worst = [f"{name} {form.format(abs(value))}" for value, name in sorted(values)[:_WORST]]
            yield f"  worst {title}: {', '.join(worst)}"


def _maplet_json(one: Photoclinometry) -> dict[str, Any]:
    shares = np.bincount(one.directions.ravel(), minlength=3) / max(one.directions.size, 1)
    known = one.maplet.sigma[np.isfinite(one.maplet.sigma)]
    return {
        "outcome": str(one.outcome),
        "reason": one.reason,
        "residual_start": one.rounds[0].residual if one.rounds else None,
        **_goodness(one.images),
        "sigma_m": float(np.median(known)) if known.size else None,
        "directions": shares.tolist(),
        "light_ratio": one.light_ratio if np.isfinite(one.light_ratio) else None,
        "rounds": [
            {"gsd_m": r.gsd, "residual": r.residual, "height_m": r.height_m, "albedo": r.albedo}
            for r in one.rounds
        ],
        "constraints": {
            fit.name: {
                "heights": fit.heights,
                "left_out": fit.left_out,
                "residual_m": fit.residual_m if np.isfinite(fit.residual_m) else None,
                "ratio": fit.ratio if np.isfinite(fit.ratio) else None,
            }
            for fit in one.constraints
        },
        "images": {fit.name: fit_json(fit) for fit in one.images},
    }


def fit_json(fit: ImageFit) -> dict[str, Any]:
    """Return how an image fits one maplet, in JSON types."""
    return {
        "fit": str(fit.fit),
        "scale": fit.scale,
        "shift_px": list(fit.shift_px),
        "residual": fit.residual,
        "correlation": fit.correlation,
        "pixels": fit.pixels,
        "gradient": list(fit.gradient),
        "noise": fit.noise,
        "pixel_m": fit.pixel_m,
    }


def image_json(fits: list[ImageFit]) -> dict[str, Any]:
    """Goodness of fit of an image over all maplets (Gaskell et al., §3.1)."""
    return {
        "maplets": sum(fit.fit is not Fit.NOT_SEEN for fit in fits),
        **_goodness(fits),
        "fits": dict(sorted(Counter(str(fit.fit) for fit in fits).items())),
    }


def _goodness(fits: Sequence[ImageFit]) -> dict[str, float | None]:
    """Return the goodness of fit of a maplet or an image: of its brightness, and of its place.

    Shifts are observed less predicted places, whose root mean square is the goodness of fit of
    Gaskell et al., §3.1.
    """
    seen = [fit for fit in fits if fit.fit is not Fit.NOT_SEEN]
    squares = [float(np.sum(np.square(fit.shift_px))) for fit in seen]
    ground = [square * fit.pixel_m**2 for square, fit in zip(squares, seen, strict=True)]
    return {
        "residual": _median(fit.residual for fit in seen),
        "noise_ratio": _median(fit.residual / fit.noise for fit in seen if fit.noise > 0.0),
        "correlation": _median(fit.correlation for fit in seen),
        "shift_px": float(np.sqrt(np.mean(squares))) if seen else None,
        "shift_m": float(np.sqrt(np.mean(ground))) if seen else None,
    }


def _findings(
    found: Mapping[str, Summary], by_image: Mapping[str, list[ImageFit]]
) -> list[dict[str, Any]]:
    """Return the outliers by code: maplets that did not end well, images that rarely fit."""
    named: dict[Outcome | Fit, list[str]] = {}
    for code in _MAPLET_CODES:
        named[code] = [name for name, one in found.items() if one.outcome is code]
    for kind in (Fit.SUN_REVERSED, Fit.CONTRADICTS):
        named[kind] = [
            name
            for name, fits in sorted(by_image.items())
            if sum(fit.fit is kind for fit in fits) > 0.5 * len(fits)
        ]
    listed = [
        {"code": str(code), "names": names, "do": WHAT_TO_DO[code]}
        for code, names in named.items()
        if names
    ]
    kept = (Outcome.TOO_FEW_IMAGES, Outcome.DIVERGED)
    fits = {name: one.images for name, one in found.items() if one.outcome not in kept}
    return [*_light_finding(found), *listed, *outlier_findings(fits)]


def _light_finding(found: Mapping[str, Summary]) -> list[dict[str, Any]]:
    """Return a finding if most maplets fit better with all Suns on the other side.

    One maplet hardly decides it: with the right Suns its ratio may be as low as 0.99.
    """
    ratios = {name: one.content["light_ratio"] for name, one in found.items()}
    known = {name: ratio for name, ratio in ratios.items() if ratio is not None}
    if not known or float(np.median(list(known.values()))) >= _DOUBTFUL_LIGHT:
        return []
    names = [name for name, ratio in known.items() if ratio < 1.0]
    do = (
        "their brightness fits better with all Suns on the other side: hills may be hollows; check "
        "the Sun in the .SUM files, and the photometric function"
    )
    return [{"code": "light-doubtful", "names": names, "do": do}]
