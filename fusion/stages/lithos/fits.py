"""How images fit maplets, or other ground."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from fusion.stages.solution_result import counted
from spcola.photometry.photoclinometry import Fit, ImageFit


@dataclass(frozen=True)
class Summary:
    """What is kept in memory of a maplet, or of other ground: not its layers.

    Parameters
    ----------
    outcome : StrEnum
        How it ended.
    images : tuple of ImageFit
    content : mapping
        In JSON types.
    """

    outcome: StrEnum
    images: tuple[ImageFit, ...]
    content: Mapping[str, Any]


def fits_by_image(found: Iterable[Summary]) -> dict[str, list[ImageFit]]:
    """Return all fits of each image."""
    by_image = defaultdict[str, list[ImageFit]](list)
    for one in found:
        for fit in one.images:
            by_image[fit.name].append(fit)
    return dict(by_image)


def mostly(kind: Fit, by_image: Mapping[str, Sequence[ImageFit]]) -> list[str]:
    """Return the images, sorted, more than half of whose fits are of a kind."""
    return [
        name
        for name, fits in sorted(by_image.items())
        if sum(fit.fit is kind for fit in fits) > 0.5 * len(fits)
    ]


def fits_json(fits: Iterable[ImageFit]) -> dict[str, Any]:
    """Return how images fit one maplet, by their names, in JSON types."""
    return {
        fit.name: {
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
        for fit in fits
    }


def images_json(by_image: Mapping[str, Sequence[ImageFit]]) -> dict[str, Any]:
    """Return the goodness of fit of images over all maplets (Gaskell et al., §3.1)."""
    return {
        name: {
            "maplets": sum(fit.fit is not Fit.NOT_SEEN for fit in fits),
            **goodness(fits),
            "fits": counted(fit.fit for fit in fits),
        }
        for name, fits in sorted(by_image.items())
    }


def goodness(fits: Sequence[ImageFit]) -> dict[str, float | None]:
    """Return the goodness of fit of a maplet or an image: of its brightness, and of its place.

    Shifts are observed less predicted places, whose root mean square is the goodness of fit of
    Gaskell et al., §3.1.
    """
    seen = [fit for fit in fits if fit.fit is not Fit.NOT_SEEN]
    squares = [float(np.sum(np.square(fit.shift_px))) for fit in seen]
    ground = [square * fit.pixel_m**2 for square, fit in zip(squares, seen, strict=True)]
    return {
        "residual": known_median(fit.residual for fit in seen),
        "noise_ratio": known_median(fit.residual / fit.noise for fit in seen if fit.noise > 0.0),
        "correlation": known_median(fit.correlation for fit in seen),
        "shift_px": float(np.sqrt(np.mean(squares))) if seen else None,
        "shift_m": float(np.sqrt(np.mean(ground))) if seen else None,
    }


def known_median(values: Iterable[float | None]) -> float | None:
    """Return the median of the values that are finite; None if there are none."""
    known = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.median(known)) if known else None
