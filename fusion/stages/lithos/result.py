"""What ``spcola spc lithos`` found: ``photoclinometry.json``, and lines for people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from fusion.runtime.findings import finding_lines
from fusion.stages.lithos.constraint_findings import constraint_findings
from fusion.stages.lithos.fits import (
    Summary,
    fits_by_image,
    fits_json,
    goodness,
    images_json,
    known_median,
    mostly,
)
from fusion.stages.lithos.outliers import outlier_findings
from fusion.stages.solution_result import SolutionResult, counted, use_line
from spcola.arrays import FloatArray
from spcola.photometry.photoclinometry import Fit, Outcome, Photoclinometry

PHOTOCLINOMETRY_KEYS = {
    "options": "what was asked for; other_photometry: functions that images do not distinguish "
    "from the one in use, and their weights in the variances, null without `spcola photometry fit`",
    "outcomes": "number of maplets by outcome",
    "residual_start": "median over maplets that were solved, relative residual of brightness of "
    "their starts",
    "residual": "the same at the end",
    "shift_m": "goodness of fit of the solution: root mean square over maplets and images of how "
    "far images are shifted, on the ground",
    "maplets[].outcome": "how it ended: converged, not-converged, undetermined, too-few-images, "
    "diverged; the last two keep the start: residual, shifts and images are those of it",
    "maplets[].reason": "why it ended so",
    "maplets[].residual_start": "median over images, relative residual of brightness of the start, "
    "on the grid of the maplet",
    "maplets[].residual": "the same at the end",
    "maplets[].noise_ratio": "median over images, residual over the noise of the image: 1 where "
    "brightness fits as well as it can",
    "maplets[].correlation": "median over images, of expected and observed brightness",
    "maplets[].shift_px": "root mean square over images of their shifts, pixels",
    "maplets[].shift_m": "the same on the ground",
    "maplets[].sigma_m": "median sigma of the heights",
    "maplets[].slope_sigma": "median sigma of the slopes of cells, along both axes of the grid",
    "maplets[].albedo_sigma": "median sigma of the relative albedo of cells, where it is known",
    "maplets[].directions": "shares of cells whose slope images determine in 0, 1, 2 directions",
    "maplets[].undetermined_azimuth_deg": "axis along which slopes are not determined in cells "
    "with one direction; across it they are: azimuth in the plane of the maplet, from north (the "
    "body-fixed +Z in that plane) towards east, 0 to 180; null with fewer than ten such cells, or "
    "where they do not agree",
    "maplets[].undetermined_agreement": "how much the axes of these cells agree: length of the "
    "mean of their double-angle vectors, 0 to 1; below 0.8 there is no azimuth",
    "maplets[].left_over": "relative residual of the largest area that most images leave over, 0.2 "
    "and more over 25 points: ground of another albedo, or steep ground; null if there is none",
    "maplets[].light_ratio": "residual of brightness with all Suns on the other side, over "
    "that with them as stated, on the coarsest GSD; median below 0.97, below 0.9 of one or two: "
    "light-doubtful",
    "maplets[].shift_ratio": "median over images of their shifts, in sigmas of their states; over "
    "1.75: images-displaced",
    "maplets[].around": "maplets of the parent that are near enough to hide and shade its ground; "
    "none if it started from the shape",
    "maplets[].rounds": "GSD (m), residual before it, changes of heights (m) and albedo (rms) of "
    "each round",
    "maplets[].constraints": "by constraint: number of heights, number left_out as false before, "
    "robust rms of them less the solved ones (residual_m), and of each over its sigma (ratio): 1 "
    "where sigmas are right and images agree",
    "maplets[].images": "fit, scale λ and its change to the edge, shift (px), residual, noise "
    "(relative), correlation, pixels, and metres a pixel, of each image",
    "images": "over all maplets: number that it shows, median residual, noise_ratio and "
    "correlation, root mean square of the shifts (px, m), maplets by fit",
    "photometry_ratios": "by photometric function, residual of brightness with it over that with "
    "the one in use, median over up to nine maplets on grids of 24 cells a side; below 0.95 and in "
    "most of them below 1: photometry-doubtful; null with fewer than three such maplets",
    "findings": "images that cannot be used, and outliers: code, names, what to do",
}
# Ratio of residuals with all Suns on the other side, and as stated, below which light is doubtful:
# of several maplets, and of fewer.
_DOUBTFUL_LIGHT, _DOUBTFUL_LIGHT_OF_FEW, _SEVERAL = 0.97, 0.9, 3
# Shifts of images, in sigmas of their states, from which on they, or constraining heights, are
# displaced.
_DISPLACED = 1.75
# Names in a printed line, and how many of the worst.
_NAMED, _WORST = 5, 3
_MAPLET_CODES = (
    Outcome.TOO_FEW_IMAGES, Outcome.DIVERGED, Outcome.UNDETERMINED, Outcome.NOT_CONVERGED,
)  # fmt: skip
WHAT_TO_DO: Mapping[Outcome | Fit, str] = {
    Outcome.TOO_FEW_IMAGES: "they keep their heights; bring more images of them, with the Sun at "
    "least 20° high, or constrain them: --constraint returns",
    Outcome.DIVERGED: "they keep their heights, whose residuals are stated; look at their images: "
    "spcola look",
    Outcome.UNDETERMINED: "their heights follow the start, and their sigmas are large: "
    "bring images in other light, or constrain them: --constraint returns",
    Outcome.NOT_CONVERGED: "they still changed in the last round: go on with more rounds: "
    "--rounds; where residuals stay far above the noise of the images, the photometric function "
    "is wrong: spcola photometry fit",
    Fit.SUN_REVERSED: "the direction of the Sun in their .SUM has a wrong sign: make their states "
    "anew: spcola sumfiles",
    Fit.CONTRADICTS: "they show other ground, or the surface at another time: check their states, "
    "or leave them out",
}


class LithosResult(SolutionResult):
    """A new solution with maplets from images; `content` is of ``photoclinometry.json``."""

    def lines(self) -> list[str]:
        """Return the lines to print."""
        maplets = self.content["maplets"].values()
        solved = [one for one in maplets if one["rounds"]]
        lines = [
            f"solution {self.solution}, from {self.parent}: {len(maplets)} maplets, {self.counts}"
        ]
        if solved:
            # Images may show enough ground of a start or of its solution only, and a maplet that
            # diverged keeps its start, which may have no sigma.
            before, after, sigma = (
                known_median(one[key] for one in solved)
                for key in ("residual_start", "residual", "sigma_m")
            )
            lines.append(
                f"  residual of brightness {_shown(before, '.1%')} → {_shown(after, '.1%')}, sigma "
                f"of heights {_shown(sigma, '.3f', ' m')} (medians)"
            )
            if self.content["options"].get("other_photometry") is None:
                lines.append(
                    "  sigmas lack errors of the photometric function: spcola photometry fit finds "
                    "them"
                )
            lines += _worst_lines(self.content)
        lines += finding_lines(self.content["findings"])
        return [*lines, use_line(self.folder)]


def summary_of(found: Photoclinometry, around: Sequence[str] = ()) -> Summary:
    """Return the summary of a maplet; `around` are the maplets that may hide and shade it."""
    return Summary(found.outcome, found.images, {**_maplet_json(found), "around": list(around)})


def content_of(
    found: Mapping[str, Summary],
    options: Mapping[str, Any],
    given: Sequence[str],
    bad_images: Iterable[Mapping[str, Any]] = (),
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
    bad_images : iterable of mapping
        Findings of images that no maplet could use; the first, as others may follow from them.
    """
    by_image = fits_by_image(found.values())
    solved = [one.content for one in found.values() if one.content["rounds"]]
    maplets = {name: one.content for name, one in found.items()}
    return {
        "options": dict(options),
        **{key: known_median(one[key] for one in solved) for key in ("residual_start", "residual")},
        "shift_m": goodness([fit for fits in by_image.values() for fit in fits])["shift_m"],
        "outcomes": counted(one.outcome for one in found.values()),
        "maplets": maplets,
        "images": images_json(by_image),
        "findings": [
            *bad_images,
            *_findings(found),
            *constraint_findings(maplets, given),
        ],
    }


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


def _median(values: FloatArray) -> float | None:
    """Return the median of the values that are known; None if none is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else None


def _maplet_json(one: Photoclinometry) -> dict[str, Any]:
    shares = np.bincount(one.directions.ravel(), minlength=3) / max(one.directions.size, 1)
    axis = one.undetermined_axis
    return {
        "outcome": str(one.outcome),
        "reason": one.reason,
        "residual_start": goodness(one.start_images)["residual"],
        **goodness(one.images),
        "sigma_m": _median(one.maplet.sigma),
        "slope_sigma": _median(one.slope_sigma),
        "albedo_sigma": _median(one.albedo_sigma),
        "directions": shares.tolist(),
        "undetermined_azimuth_deg": axis.azimuth_deg if axis.known else None,
        "undetermined_agreement": axis.agreement if np.isfinite(axis.agreement) else None,
        "left_over": one.left_over if np.isfinite(one.left_over) else None,
        "light_ratio": one.light_ratio if np.isfinite(one.light_ratio) else None,
        "shift_ratio": one.shift_ratio if np.isfinite(one.shift_ratio) else None,
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
        "images": fits_json(one.images),
    }


def _findings(found: Mapping[str, Summary]) -> list[dict[str, Any]]:
    """Return the outliers by code: maplets that did not end well, images that rarely fit.

    Images of maplets that keep their start are compared with that, so that they do not count.
    """
    kept = (Outcome.TOO_FEW_IMAGES, Outcome.DIVERGED)
    moved = {name: one for name, one in found.items() if one.outcome not in kept}
    named: dict[Outcome | Fit, list[str]] = {}
    for code in _MAPLET_CODES:
        named[code] = [name for name, one in found.items() if one.outcome is code]
    for kind in (Fit.SUN_REVERSED, Fit.CONTRADICTS):
        named[kind] = mostly(kind, fits_by_image(moved.values()))
    does = {**WHAT_TO_DO, Outcome.DIVERGED: _why_diverged(found, named[Outcome.DIVERGED])}
    listed = [
        {"code": str(code), "names": names, "do": does[code]}
        for code, names in named.items()
        if names
    ]
    fits = {name: one.images for name, one in moved.items()}
    solved = {name: one.content for name, one in moved.items()}
    others = _displaced_finding(solved), _left_over_finding(solved), outlier_findings(fits)
    return [*_light_finding(found), *listed, *chain.from_iterable(others)]


def _why_diverged(found: Mapping[str, Summary], names: Sequence[str]) -> str:
    """Return the reasons of the first maplets that diverged, and what to do."""
    why = [f"{name}: {found[name].content['reason']}" for name in names[:_WORST]]
    return f"{', '.join(why)}; {WHAT_TO_DO[Outcome.DIVERGED]}"


def _left_over_finding(maplets: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a finding of maplets with an area that most images show brighter, or darker.

    Its pixels count as outliers, so that no residual of an image shows it.
    """
    names = [name for name, one in maplets.items() if one["left_over"] is not None]
    do = (
        "an area of them is far brighter or darker in most images than expected, so that slopes "
        "are wrong there: look at the residuals in report or page; ground of more than twice the "
        'mean albedo of its maplet needs [lithos] albedo_mean = "0.5"; '
        "steep ground that the start lacks a better start"
    )
    return [{"code": "albedo-left-over", "names": names, "do": do}] if names else []


def _displaced_finding(maplets: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a finding of maplets whose images lie far from where their states put them.

    Heights in the wrong place move all of their images, and fit them as well as right ones.
    """
    names = [name for name, one in maplets.items() if (one["shift_ratio"] or 0.0) > _DISPLACED]
    do = (
        f"most of their images lie more than {_DISPLACED:g} sigmas from where their states put "
        "them: check the place of the heights that constrain them (spcola register, the frame of a "
        "map), or fit the states: spcola spc register"
    )
    return [{"code": "images-displaced", "names": names, "do": do}] if names else []


def _light_finding(found: Mapping[str, Summary]) -> list[dict[str, Any]]:
    """Return a finding if most maplets fit better with all Suns on the other side.

    One or two maplets hardly decide it: with the right Suns their ratio may be as low as 0.95.
    """
    ratios = {name: one.content["light_ratio"] for name, one in found.items()}
    known = {name: ratio for name, ratio in ratios.items() if ratio is not None}
    limit = _DOUBTFUL_LIGHT if len(known) >= _SEVERAL else _DOUBTFUL_LIGHT_OF_FEW
    if not known or float(np.median(list(known.values()))) >= limit:
        return []
    names = [name for name, ratio in known.items() if ratio < 1.0]
    do = (
        "their brightness fits better with all Suns on the other side: hills may be hollows; check "
        "the Sun in the .SUM files, and the photometric function"
    )
    return [{"code": "light-doubtful", "names": names, "do": do}]
