"""The registration by images, or by topography and images together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fusion.registration.by_images import ImagedMapolas
from fusion.registration.combine import KindSizes, combine
from fusion.registration.fit import FitOptions, Registration, fit_transform
from fusion.registration.match import Match
from fusion.registration.summary import MatchedMapolas, registration_json
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.maplet import MapletGrid

Kind = Literal["images", "both"]
# Where covariances hold the sizes of what errs, what may be left is expected at this share of the
# error of a maplet's centre.
_LEFT = 0.1


@dataclass(frozen=True, eq=False)
class KindRegistration:
    """A registration by images, or by both kinds of match.

    Attributes
    ----------
    registration : Registration
    mapolas : MatchedMapolas
        With the matches that entered.
    sizes : KindSizes
        NaN of a kind that did not enter.
    chi2 : (N,) ndarray
        As of :class:`fusion.registration.combine.CombinedMatches`; NaN where one kind entered.
    """

    registration: Registration
    mapolas: MatchedMapolas
    sizes: KindSizes
    chi2: FloatArray


def fit_mapolas(
    mapolas: MatchedMapolas, further: Sequence[FloatArray] = (), *, options: FitOptions
) -> Registration:
    """Fit the transform to the mapolas that match; `further` are groups of effects (N, 3, M).

    Raises
    ------
    NotObservableError
        If they are too few or lie so that a parameter is free.
    """
    usable = mapolas.usable
    matches = [match for match in mapolas.matches if match.usable]
    if not matches:
        raise NotObservableError(
            f"none of {len(mapolas.matches)} mapolas matches ({mapolas.matches[0].reason})"
        )
    displacement = np.stack([match.displacement for match in matches])
    covariance = np.stack([match.covariance for match in matches]) + mapolas.beside[usable]
    groups = [group[usable] for group in further]
    landmarks = mapolas.landmarks
    if landmarks is not None:
        displacement = displacement - landmarks.offset[usable]
        covariance = covariance + landmarks.own[usable]
        groups.append(landmarks.shared[usable])
        options = replace(
            options,
            center_sigma_m=_LEFT * options.center_sigma_m,
            # Most of what landmarks share is what no match tells from the transform.
            stated=(*options.stated, len(groups)),
        )
    return fit_transform(
        np.stack([match.center for match in matches]),
        displacement,
        covariance,
        mapolas.effects[usable],
        further=groups,
        options=options,
    )


def register_kinds(
    by: Kind,
    grids: Sequence[MapletGrid],
    topography: MatchedMapolas,
    images: ImagedMapolas,
    *,
    options: FitOptions,
) -> KindRegistration:
    """Register mapolas by where images show them, alone or with the topography.

    Both kinds are fitted alone first, which tells how large the errors of each are.

    Parameters
    ----------
    by : {"images", "both"}
    grids : sequence of N MapletGrid
        Of the mapolas.
    topography : MatchedMapolas
        By their heights.
    images : ImagedMapolas
    options : FitOptions

    Raises
    ------
    NotObservableError
        If too few match, or a parameter of the model is free.
    """
    nothing = np.full(len(grids), np.nan)
    seen = replace(topography, matches=images.matches)
    if by == "images":
        registration = _fit_seen(seen, [images.effects, images.common], options)
        sizes = KindSizes(float("nan"), registration.fit.sizes.independent)
        return KindRegistration(registration, seen, sizes, nothing)
    sizes = KindSizes(
        _size(topography, [], options), _size(seen, [images.effects, images.common], options)
    )
    joined = combine(grids, topography.matches, images, sizes, reject=options.reject)
    mapolas = replace(topography, matches=joined.matches)
    left = replace(options, center_sigma_m=_LEFT * options.center_sigma_m)
    registration = _fit_seen(mapolas, [joined.effects, images.common], left)
    return KindRegistration(registration, mapolas, sizes, joined.chi2)


def _fit_seen(
    mapolas: MatchedMapolas, further: list[FloatArray], options: FitOptions
) -> Registration:
    """Fit matches by images, the errors of scans as large as their adjustment says.

    The last group of `further` are errors that no match tells from the transform.

    Images err smoothly over the body too. A factor on the errors of scans would be made to explain
    that, and the translation, which no match tells from an error that all scans share, would be
    told too uncertain by it.
    """
    alone = replace(mapolas, effects=mapolas.effects[:, :, :0])
    sizes = fit_mapolas(alone, further[:-1], options=options).fit.sizes
    held = (sizes.independent, 1.0, *sizes.shared[1:], 1.0)
    return fit_mapolas(mapolas, further, options=replace(options, held=held))


def _size(mapolas: MatchedMapolas, further: list[FloatArray], options: FitOptions) -> float:
    """Error size of a kind of match by its own fit, metres; what was expected, if there is none."""
    try:
        fit = _fit_seen if further else fit_mapolas
        return fit(mapolas, further, options=options).fit.sizes.independent
    except NotObservableError:
        return options.center_sigma_m


def kinds_json(
    by: Kind,
    found: KindRegistration,
    topography: Sequence[Match],
    images: ImagedMapolas,
) -> dict[str, Any]:
    """Content of ``registration.json``, with what images told."""
    content = registration_json(found.registration, found.mapolas)
    used = {image.name for sighting in images.sightings for image in sighting.images}
    content |= {
        "by": by,
        "maplet_sigma_m": found.sizes.topography,
        "image_sigma_m": found.sizes.images,
        "image_match_factor": images.factors.match,
        "image_position_factor": images.factors.position,
        "image_pointing_factor": images.factors.pointing,
        "n_images": len(used),
    }
    rows = zip(content["per_mapola"], topography, images.sightings, found.chi2, strict=True)
    for entry, ground, sighting, chi2 in rows:
        placed = found.registration.transform.apply(ground.center) + entry["scan_shift_m"]
        surface = ground.center + ground.displacement - placed
        entry |= {
            "n_images": len(sighting),
            "images_left_out": dict(Counter(sighting.left_out.values())),
            "surface_residual_m": surface if ground.usable else np.full(3, np.nan),
            "kinds_chi2": chi2,
        }
    return content
