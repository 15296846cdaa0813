"""The registration by images, or by topography and images together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from fusion.estimation import ErrorSizes
from fusion.registration.fit.fit import (
    FitOptions,
    Registration,
    fit_transform,
    similarity_numbers,
)
from fusion.registration.observations.by_images import ImagedMapolas
from fusion.registration.observations.combine import KindSizes, both_kinds
from fusion.registration.results.summary import MatchedMapolas, registration_json
from fusion.surfacematch import Match
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

Kind = Literal["images", "both"]
# Where what landmarks do is known, what may be left is expected at this share of the error of a
# maplet's centre.
_LEFT = 0.1
# What is told of each kind of match.
_OF_A_KIND = ("displacement_m", "sigma_m", "residual_m", "used", "reason", "correlation")


@dataclass(frozen=True, eq=False)
class KindRegistration:
    """A registration by images, or by both kinds of match.

    Attributes
    ----------
    registration : Registration
    mapolas : MatchedMapolas
        With the matches that entered: N, or 2N of both kinds, those by topography first.
    sizes : KindSizes
        NaN of a kind that did not enter.
    chi2 : (N,) ndarray
        As of :class:`fusion.registration.observations.combine.JointMatches`, also where one kind
        entered.
    turn_deg, turn_sigma_deg : (3,) ndarray
        Rotation from the fit by topography alone to that by images alone; NaN where one of them
        cannot be fitted.
    """

    registration: Registration
    mapolas: MatchedMapolas
    sizes: KindSizes
    chi2: FloatArray
    turn_deg: FloatArray
    turn_sigma_deg: FloatArray


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
    topography: MatchedMapolas,
    images: ImagedMapolas,
    *,
    options: FitOptions,
) -> KindRegistration:
    """Register mapolas by where images show them, alone or with the topography.

    Both kinds are fitted alone first, which tells how large the errors of each are, and whether
    they contradict each other; then the matches of both are rows of one fit.

    Parameters
    ----------
    by : {"images", "both"}
    topography : MatchedMapolas
        By their heights.
    images : ImagedMapolas
    options : FitOptions

    Raises
    ------
    NotObservableError
        If too few match, or a parameter of the model is free.
    """
    seen = replace(topography, matches=images.matches, landmarks=None)
    ground = _alone(lambda: fit_mapolas(topography, options=options))
    of_ground = _sizes(ground, options)
    if by == "images":
        alone = _fit_seen(seen, images, options)
        own = alone.fit.sizes.independent
        compared = both_kinds(topography, images, KindSizes(of_ground.independent, own))
        sizes = KindSizes(float("nan"), own)
        return KindRegistration(alone, seen, sizes, compared.chi2, *_turn(ground, alone))
    shown = _alone(lambda: _fit_seen(seen, images, options))
    of_images = _sizes(shown, options)
    sizes = KindSizes(of_ground.independent, of_images.independent)
    joint = both_kinds(topography, images, sizes, reject=options.reject)
    stated = (1.0,) if topography.landmarks is None else (1.0, 1.0)
    held = (0.0, of_ground.shared[0], of_images.shared[1], *stated)
    groups, options = [joint.effects, joint.common], replace(options, held=held)
    registration = fit_mapolas(joint.rows, groups, options=options)
    return KindRegistration(registration, joint.rows, sizes, joint.chi2, *_turn(ground, shown))


def _fit_seen(mapolas: MatchedMapolas, images: ImagedMapolas, options: FitOptions) -> Registration:
    """Fit matches by images, the errors of scans as large as their adjustment says.

    Images err smoothly over the body too. A factor on the errors of scans would be made to explain
    that, and the translation, which no match tells from an error that all scans share, would be
    told too uncertain by it.
    """
    alone = replace(mapolas, effects=mapolas.effects[:, :, :0])
    sizes = fit_mapolas(alone, [images.effects], options=options).fit.sizes
    held = (sizes.independent, 1.0, *sizes.shared[1:], 1.0)
    groups = [images.effects, images.common]
    return fit_mapolas(mapolas, groups, options=replace(options, held=held))


def _alone(fit: Callable[[], Registration]) -> Registration | None:
    """Return the fit of one kind of match; None if it is not determined."""
    try:
        return fit()
    except NotObservableError:
        return None


def _sizes(fitted: Registration | None, options: FitOptions) -> ErrorSizes:
    """Error sizes of a kind of match by its own fit; what was expected, if there is none."""
    if fitted is None:
        return ErrorSizes(options.center_sigma_m, (1.0, 1.0))
    return fitted.fit.sizes


def _turn(one: Registration | None, other: Registration | None) -> tuple[FloatArray, FloatArray]:
    """Rotation vector (3,) from one fit to another and its sigma, degrees; NaN without both.

    Their errors are taken as independent, which what scans do to both makes too large.
    """
    if one is None or other is None:
        return np.full(3, np.nan), np.full(3, np.nan)
    between = Rotation.from_matrix(other.similarity.rotation @ one.similarity.rotation.T)
    sigmas = [similarity_numbers(fitted)[3] for fitted in (one, other)]
    return np.degrees(between.as_rotvec()), np.degrees(np.hypot(*sigmas))


def kinds_json(
    by: Kind,
    found: KindRegistration,
    topography: Sequence[Match],
    images: ImagedMapolas,
) -> dict[str, Any]:
    """Content of ``registration.json``, with what images told."""
    content = registration_json(found.registration, found.mapolas)
    entries = content["per_mapola"]
    if by == "both":
        entries = _joined(entries, found.mapolas.matches)
        left = [entry["residual_m"] for entry in entries if entry["used"]]
        content["residual_std_m"] = np.std(np.array(left).reshape(-1, 3), axis=0)
    used = {image.name for sighting in images.sightings for image in sighting.images}
    looked_at = used.union(*(sighting.left_out for sighting in images.sightings))
    count = sum(entry["used"] for entry in entries)
    content |= {
        "by": by,
        "n_used": count,
        "n_rejected": len(entries) - count,
        "maplet_sigma_m": found.sizes.topography,
        "image_sigma_m": found.sizes.images,
        "image_match_factor": images.factors.match,
        "image_position_factor": images.factors.position,
        "image_pointing_factor": images.factors.pointing,
        "n_images": len(used),
        "n_images_compared": len(looked_at),
        "kinds_rotation_deg": found.turn_deg,
        "kinds_rotation_sigma_deg": found.turn_sigma_deg,
        "images_not_matched": sorted(looked_at - used),
        "per_mapola": entries,
    }
    for entry, ground, sighting, chi2 in zip(
        entries, topography, images.sightings, found.chi2, strict=True
    ):
        placed = found.registration.transform.apply(ground.center) + entry["scan_shift_m"]
        surface = ground.center + ground.displacement - placed
        entry |= {
            "n_images": len(sighting),
            "images_left_out": dict(Counter(sighting.left_out.values())),
            "surface_residual_m": surface if ground.usable else np.full(3, np.nan),
            "kinds_chi2": chi2,
        }
    return content


def _joined(entries: list[dict[str, Any]], matches: Sequence[Match]) -> list[dict[str, Any]]:
    """Return one entry for each mapola of those of both kinds, which stand one after the other.

    Where both were used, displacement and residual are their means by information.
    """
    count, joined = len(entries) // 2, []
    for row in range(count):
        ground, seen = entries[row], entries[count + row]
        entry = dict(seen if seen["used"] and not ground["used"] else ground)
        if ground["used"] and seen["used"]:
            by_ground, by_seen = matches[row].covariance, matches[count + row].covariance
            share = np.linalg.solve(by_ground + by_seen, by_ground).T
            for key in ("displacement_m", "residual_m"):
                entry[key] = ground[key] + share @ (seen[key] - ground[key])
            entry["sigma_m"] = np.sqrt(np.diag(share @ by_seen))
        entry["kinds"] = {
            kind: {key: told[key] for key in _OF_A_KIND}
            for kind, told in (("topography", ground), ("images", seen))
        }
        joined.append(entry)
    return joined
