"""What ``spcola spc albedo`` found: ``albedo.json``, and lines for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fusion.runtime.findings import finding_lines
from fusion.stages.albedo.placing import PlacedMapola
from fusion.stages.lithos.fits import (
    Summary,
    fits_by_image,
    fits_json,
    goodness,
    images_json,
    known_median,
    mostly,
)
from fusion.stages.lithos.result import WHAT_TO_DO
from fusion.stages.solution_result import SolutionResult, counted, use_line
from spcola.grids import Maplet
from spcola.math.robust import mad
from spcola.photometry.albedo import AlbedoOutcome, AlbedoSolution
from spcola.photometry.photoclinometry import Fit, ImageFit

ALBEDO_FILE = "albedo.json"
ALBEDO_KEYS = {
    "options": "what was asked for",
    "outcomes": "number of surfaces by outcome",
    "residual_start": "median over surfaces, relative residual of brightness with an even albedo",
    "residual": "the same at the end",
    "shift_m": "root mean square over surfaces and images of how far images are shifted, on the "
    "ground",
    "surfaces[].outcome": "how it ended, by the names of maplets or bigmaps: converged, "
    "not-converged, no-image",
    "surfaces[].residual_start": "median over images, relative residual of brightness with an "
    "even albedo",
    "surfaces[].residual": "the same at the end",
    "surfaces[].noise_ratio": "median over images, residual over the noise of the image",
    "surfaces[].correlation": "median over images, of expected and observed brightness",
    "surfaces[].shift_px": "root mean square over images of their shifts, pixels",
    "surfaces[].shift_m": "the same on the ground",
    "surfaces[].gsd_m": "GSD of the surface",
    "surfaces[].sigma_m": "median sigma of its heights, which are kept",
    "surfaces[].share": "share of the points with a height whose albedo images determine",
    "surfaces[].scatter": "robust standard deviation of the albedo over its mean",
    "surfaces[].sigma": "median sigma of the albedo",
    "surfaces[].changes": "rms change of the albedo in each round, relative to its mean",
    "surfaces[].residuals": "residual before each round",
    "surfaces[].images": "fit, scale λ, shift (px), residual, correlation, pixels of each image",
    "surfaces[].mapola": "of a mapola: name that it has as one; else absent, as are the next three",
    "surfaces[].moved_m": "from the registered place to the mean of it and that by images",
    "surfaces[].center_sigma_m": "of V, along each axis",
    "surfaces[].measured": "images in which V was measured: these have it in their .SUM",
    "images": "over all surfaces: number used, median residual and correlation, worst fit",
    "findings": "images that cannot be used, and outliers: code, names, what to do",
    "made_from": "of bigmaps: SHA-256 of the .MAP, states, pixels and shape, by path",
}
_OUTCOMES: Mapping[AlbedoOutcome, str] = {
    AlbedoOutcome.NO_IMAGE: "they keep the albedo that they had, mapolas an even one; bring "
    "images of them: spcola images",
    AlbedoOutcome.NOT_CONVERGED: "their albedo may be used; go on with more rounds: --rounds",
}
_UNPLACED = "not-in-images"


class AlbedoResult(SolutionResult):
    """Albedo of maplets or mapolas in a new solution, or of bigmaps.

    `content` is of ``albedo.json``, in `folder`. Bigmaps stay in their solution: `solution` and
    `parent` are the same.
    """

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``--json``."""
        made = {"solution": self.solution, "parent": self.parent, "folder": self.folder}
        return {**made, **self.content}

    def lines(self) -> list[str]:
        """Return the lines to print."""
        what = self.content["options"]["of"]
        surfaces = self.content["surfaces"].values()
        whole = "" if what == "bigmaps" else f"solution {self.solution}, from {self.parent}: "
        lines = [f"{whole}albedo of {len(surfaces)} {what}, {self.counts}"]
        solved = [one for one in surfaces if one["share"]]
        if solved:
            before, after, share, scatter, sigma = (
                float(np.median([one[key] for one in solved]))
                for key in ("residual_start", "residual", "share", "scatter", "sigma")
            )
            lines.append(
                f"  residual of brightness {before:.1%} → {after:.1%}; albedo scatters by "
                f"{scatter:.1%}, sigma {sigma:.3f}, known at {share:.0%} of the points (medians)"
            )
        if what == "mapolas":
            moved = [float(np.linalg.norm(one["moved_m"])) for one in surfaces if one["measured"]]
            far = f", moved by {np.median(moved):.3g} m (median)" if moved else ""
            lines.append(f"  centres: {len(moved)} of {len(surfaces)} by images{far}")
        lines += finding_lines(self.content["findings"])
        if what == "bigmaps":
            return [*lines, f"  {self.folder}"]
        return [*lines, use_line(self.folder)]


def summary_of(
    found: AlbedoSolution, ground: Maplet, placed: PlacedMapola | None = None
) -> Summary:
    """Return the summary of the albedo of `ground`."""
    return Summary(found.outcome, found.images, _surface_json(found, ground, placed))


def content_of(
    found: Mapping[str, Summary],
    options: Mapping[str, Any],
    bad_images: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return the content of ``albedo.json``.

    Parameters
    ----------
    found : mapping of str to Summary
        By the names of maplets or bigmaps.
    options : mapping
        In JSON types.
    bad_images : sequence of mapping
        Findings of images that no surface could use; the first, as others may follow from them.
    """
    by_image = fits_by_image(found.values())
    solved = [one.content for one in found.values() if one.content["share"]]
    return {
        "options": dict(options),
        "outcomes": counted(one.outcome for one in found.values()),
        **{
            key: float(np.median([one[key] for one in solved])) if solved else None
            for key in ("residual_start", "residual")
        },
        "shift_m": goodness([fit for fits in by_image.values() for fit in fits])["shift_m"],
        "surfaces": {name: one.content for name, one in found.items()},
        "images": images_json(by_image),
        "findings": [*bad_images, *_findings(found, by_image)],
    }


def _surface_json(
    found: AlbedoSolution, ground: Maplet, placed: PlacedMapola | None
) -> dict[str, Any]:
    solved = np.isfinite(found.albedo)
    some, known = bool(solved.any()), int(np.count_nonzero(ground.valid))
    content = {
        **goodness(found.images),
        "outcome": str(found.outcome),
        "residual_start": found.residual_start if some else None,
        "residual": found.residual if some else None,
        "share": np.count_nonzero(solved) / max(known, 1),
        "scatter": float(mad(found.albedo)) / found.mean if some else None,
        "sigma": float(np.median(found.sigma[solved])) if some else None,
        "changes": list(found.changes),
        "residuals": list(found.residuals),
        "gsd_m": ground.grid.gsd,
        "sigma_m": known_median(ground.sigma.ravel()),
        "images": fits_json(found.images),
    }
    if placed is None:
        return content
    return content | {
        "mapola": placed.mapola,
        "moved_m": placed.moved.tolist(),
        "center_sigma_m": placed.maplet.center_sigma.tolist(),
        "measured": [one.name for one in placed.pictures] if placed.measured else [],
    }


def _findings(
    found: Mapping[str, Summary], by_image: Mapping[str, list[ImageFit]]
) -> list[dict[str, Any]]:
    """Return the outliers by code: ground without images, images that rarely fit."""
    named: list[tuple[str, list[str], str]] = [
        (str(code), [name for name, one in found.items() if one.outcome is code], do)
        for code, do in _OUTCOMES.items()
    ]
    unplaced = [name for name, one in found.items() if one.content.get("measured") == []]
    named.append((
        _UNPLACED, unplaced, "images do not show them where they may be: their "
        "centres are the registration's"
    ))  # fmt: skip
    doubtful = mostly(Fit.CONTRADICTS, by_image)
    named.append((str(Fit.CONTRADICTS), doubtful, WHAT_TO_DO[Fit.CONTRADICTS]))
    return [{"code": code, "names": names, "do": do} for code, names, do in named if names]
