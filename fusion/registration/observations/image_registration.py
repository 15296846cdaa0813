"""Registration by images, or by topography and images together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from fusion.estimation import ErrorSizes
from fusion.registration.fit import FitOptions, MatchedMapolas, Registration, fit_mapolas
from fusion.registration.observations.by_images import ImagedMapolas
from fusion.registration.observations.combine import ObservationTypeSizes, joint_matches
from fusion.registration.results import registration_json
from fusion.surfacematch import Match
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

ObservationTypes = Literal["images", "both"]
# Numbers reported for each observation type.
_OF_A_TYPE = ("displacement_m", "sigma_m", "residual_m", "used", "reason", "cause", "correlation")


@dataclass(frozen=True, eq=False)
class ImageRegistration:
    """A registration by images, or by images and topography.

    Attributes
    ----------
    registration : Registration
    mapolas : MatchedMapolas
        With the matches used: N, or 2N of both types, those by topography first.
    sizes : ObservationTypeSizes
        NaN for a type that was not used.
    chi2 : (N,) ndarray
        As in :class:`fusion.registration.observations.combine.JointMatches`, also if only images
        were used.
    turn_deg, turn_sigma_deg : (3,) ndarray
        Rotation from the fit by topography alone to that by images alone; NaN if one of them
        cannot be fitted.
    """

    registration: Registration
    mapolas: MatchedMapolas
    sizes: ObservationTypeSizes
    chi2: FloatArray
    turn_deg: FloatArray
    turn_sigma_deg: FloatArray


def register_with_images(
    by: ObservationTypes,
    topography: MatchedMapolas,
    images: ImagedMapolas,
    *,
    options: FitOptions,
) -> ImageRegistration:
    """Register mapolas by their positions from images, alone or with the topography.

    Both observation types are fitted alone first, which gives their error sizes and shows whether
    they contradict each other; then the matches of both are rows of one fit.

    Parameters
    ----------
    by : {"images", "both"}
    topography : MatchedMapolas
        Matched by their heights.
    images : ImagedMapolas
    options : FitOptions

    Raises
    ------
    NotObservableError
        If too few match, or a parameter of the model is not determined.
    """
    imaged = replace(topography, matches=images.matches, landmarks=None)
    ground = _alone(lambda: fit_mapolas(topography, options=options))
    of_ground = _sizes(ground, options)
    if by == "images":
        alone = _fit_images(imaged, images, options)
        own = alone.fit.sizes.independent
        compared = joint_matches(
            topography, images, ObservationTypeSizes(of_ground.independent, own)
        )
        sizes = ObservationTypeSizes(float("nan"), own)
        return ImageRegistration(alone, imaged, sizes, compared.chi2, *_turn(ground, alone))
    by_images = _alone(lambda: _fit_images(imaged, images, options))
    of_images = _sizes(by_images, options)
    sizes = ObservationTypeSizes(of_ground.independent, of_images.independent)
    joint = joint_matches(topography, images, sizes, reject=options.reject)
    ones = (1.0,) if topography.landmarks is None else (1.0, 1.0)
    fixed = (0.0, of_ground.shared[0], of_images.shared[1], *ones)
    groups, options = [joint.effects, joint.common], replace(options, fixed_sizes=fixed)
    registration = fit_mapolas(joint.rows, groups, options=options)
    turn = _turn(ground, by_images)
    return ImageRegistration(registration, joint.rows, sizes, joint.chi2, *turn)


def _fit_images(
    mapolas: MatchedMapolas, images: ImagedMapolas, options: FitOptions
) -> Registration:
    """Fit matches by images, with the errors of scans at the size that their adjustment gave.

    Errors of images vary smoothly over the body as well. An estimated factor on the errors of scans
    would absorb them, and the sigma of the translation, which matches do not separate from an
    error shared by all scans, would come out too large.
    """
    alone = replace(mapolas, effects=mapolas.effects[:, :, :0])
    sizes = fit_mapolas(alone, [images.effects], options=options).fit.sizes
    fixed = (sizes.independent, 1.0, *sizes.shared[1:], 1.0)
    groups = [images.effects, images.common]
    return fit_mapolas(mapolas, groups, options=replace(options, fixed_sizes=fixed))


def _alone(fit: Callable[[], Registration]) -> Registration | None:
    """Return the fit of one observation type; None if it is not determined."""
    try:
        return fit()
    except NotObservableError:
        return None


def _sizes(fitted: Registration | None, options: FitOptions) -> ErrorSizes:
    """Error sizes of an observation type by its own fit; their prior medians without a fit."""
    if fitted is None:
        return ErrorSizes(options.center_sigma_m, (1.0, 1.0))
    return fitted.fit.sizes


def _turn(one: Registration | None, other: Registration | None) -> tuple[FloatArray, FloatArray]:
    """Rotation vector (3,) from one fit to another and its sigma, degrees; NaN without both.

    Their errors are taken as independent; the shared errors of scans make this sigma too large.
    """
    if one is None or other is None:
        return np.full(3, np.nan), np.full(3, np.nan)
    between = Rotation.from_matrix(other.similarity.rotation @ one.similarity.rotation.T)
    sigmas = [fitted.similarity_numbers()[3] for fitted in (one, other)]
    return np.degrees(between.as_rotvec()), np.degrees(np.hypot(*sigmas))


def image_registration_json(
    by: ObservationTypes,
    found: ImageRegistration,
    topography: Sequence[Match],
    images: ImagedMapolas,
) -> dict[str, Any]:
    """Content of ``registration.json`` with the results of images.

    Parameters
    ----------
    by : {"images", "both"}
    found : ImageRegistration
    topography : sequence of Match
        Matches of heights.
    images : ImagedMapolas
    """
    content = registration_json(found.registration, found.mapolas)
    entries = content["per_mapola"]
    if by == "both":
        entries = _joined(entries, found.mapolas.matches)
        left = [entry["residual_m"] for entry in entries if entry["used"]]
        content["residual_std_m"] = np.std(np.array(left).reshape(-1, 3), axis=0)
    used = {image.name for sighting in images.sightings for image in sighting.images}
    compared = used.union(*(sighting.left_out for sighting in images.sightings))
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
        "n_images_compared": len(compared),
        "types_rotation_deg": found.turn_deg,
        "types_rotation_sigma_deg": found.turn_sigma_deg,
        "images_not_matched": sorted(compared - used),
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
            "types_chi2": chi2,
        }
    return content


def _joined(entries: list[dict[str, Any]], matches: Sequence[Match]) -> list[dict[str, Any]]:
    """Join N entries by topography and, after them, N by images to one for each mapola.

    If both were used, displacement and residual are means weighted by the inverse covariances.
    """
    count, joined = len(entries) // 2, []
    for row in range(count):
        ground, imaged = entries[row], entries[count + row]
        entry = dict(imaged if imaged["used"] and not ground["used"] else ground)
        if ground["used"] and imaged["used"]:
            by_ground, by_images = matches[row].covariance, matches[count + row].covariance
            share = np.linalg.solve(by_ground + by_images, by_ground).T
            for key in ("displacement_m", "residual_m"):
                entry[key] = ground[key] + share @ (imaged[key] - ground[key])
            entry["sigma_m"] = np.sqrt(np.diag(share @ by_images))
        entry["observation_types"] = {
            name: {key: values[key] for key in _OF_A_TYPE}
            for name, values in (("topography", ground), ("images", imaged))
        }
        joined.append(entry)
    return joined
