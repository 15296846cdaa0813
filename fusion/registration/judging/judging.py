"""Acceptance tests of a registration: agreement of the surfaces within their sigmas.

Each test has a limit that correct input passes with a margin and some kind of wrong input exceeds:
docs/validation/wrong_input.md has the rates of false alarms and misses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.registration.judging.common_ground import CommonRelief
from spcola.arrays import FloatArray

# Shares of the mapolas that show the relief of SPC, and that agree with the transform: below the
# first a registration is doubtful, below the second it is refused.
_DOUBTFUL_SHARE, _REFUSED_SHARE = 0.5, 0.25
# Share of the compared images that show the ground of a mapola: above 0.9 with correct input, below
# 0.3 with images that are mirrored, exchanged or of another body.
_MATCHED_IMAGES = 0.75
# Root of the median χ² between the positions of a mapola by images and by heights, over its
# expectation: 0.8 to 1.4 with correct input. Beyond the second limit the frames differ.
_DOUBTFUL_TYPES, _REFUSED_TYPES = 2.0, 4.0
# Standard deviations between the rotations by images and by heights alone: up to 2 with correct
# input.
_DOUBTFUL_APART, _REFUSED_APART = 5.0, 25.0
# Images named in a finding.
_NAMED = 5
# Median over the mapolas of the standard deviation of the height residuals, in stated sigmas.
_DOUBTFUL_CHI, _REFUSED_CHI = 1.5, 4.0
# Ratio of estimated to stated error of maplets' centres.
_DOUBTFUL_CENTER, _REFUSED_CENTER = 2.5, 10.0
# Significance level of the strain test.
_STRAIN_CHANCE = 1e-6
# Standard deviations by which a scale or rotation must exceed its limit to be called large.
_BEYOND = 3.0
# Beyond this many times its limit a scale is refused.
_ABSURD = 10.0


@dataclass(frozen=True)
class RegistrationLimits:
    """Largest plausible differences of two solutions of one body.

    Parameters
    ----------
    rotation_deg : float
        Largest rotation between their frames, degrees.
    scale : float
        Largest scale less 1.
    center_sigma_m : float
        Expected error of a maplet's centre, metres.
    """

    rotation_deg: float
    scale: float
    center_sigma_m: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """Agreement of the surfaces after a registration.

    Attributes
    ----------
    relief : CommonRelief
        For a sample of the mapolas.
    chi : (N,) ndarray
        Robust standard deviation of each mapola's height residuals, in stated sigmas; NaN without
        stated sigma or match.
    """

    relief: CommonRelief
    chi: FloatArray

    def as_json(self) -> dict[str, Any]:
        """Return the numbers as ``registration.json`` has them under ``agreement``."""
        known = self.chi[np.isfinite(self.chi)]
        z_score = self.relief.z_score[np.isfinite(self.relief.z_score)]
        return {
            "mapolas_compared": self.relief.compared,
            "share_with_common_relief": self.relief.share,
            "share_by_chance": self.relief.chance,
            "median_z_score": float(np.median(z_score)) if len(z_score) else None,
            "residual_over_sigma": float(np.median(known)) if len(known) else None,
        }


def judge_registration(
    content: Mapping[str, Any], evidence: Evidence, limits: RegistrationLimits
) -> Verdict:
    """Judge a registration by its numbers and by the agreement of the surfaces.

    Parameters
    ----------
    content : mapping
        ``registration.json`` without its verdict.
    evidence : Evidence
    limits : RegistrationLimits

    Returns
    -------
    Verdict
        Findings against the registration, the most severe first; notes name the parameters that it
        determines weakly.
    """
    found = [
        *judge_relief(evidence.relief),
        *_agreeing(content),
        *_images(content),
        *_observation_types(content),
        *_heights(evidence.chi),
        *_centers(content, limits),
        *_scale(content, limits),
        *_rotation(content, limits),
        *_strain(content),
    ]
    if not content["converged"]:
        text = f"the fit did not converge ({content['reason']})"
        found.append(Finding(Code.NOT_CONVERGED, Severity.DOUBTFUL, text))
    found += [
        Finding(Code.WEAKLY_DETERMINED, Severity.NOTE, text)
        for text in content.get("reasons") or ()
    ]
    order = list(Severity)
    return Verdict(tuple(sorted(found, key=lambda one: -order.index(one.severity))))


def judge_relief(relief: CommonRelief) -> Iterator[Finding]:
    """Test whether surfaces show the same relief where a transform places them."""
    if not relief.compared:
        text = "the surfaces have too little relief to verify that they show the same ground"
        yield Finding(Code.NO_RELIEF, Severity.DOUBTFUL, text)
        return
    text = (
        f"{int(relief.shown.sum())} of {relief.compared} surfaces compared show the same relief "
        "where the transform places them; the others agree no better than unrelated ground"
    )
    yield from _below(Code.RELIEF_UNRELATED, relief.share, text)


def _agreeing(content: Mapping[str, Any]) -> Iterator[Finding]:
    """Test the share of mapolas that agree with the common transform."""
    total = content["n_used"] + content["n_rejected"]
    share = content["n_used"] / total if total else 0.0
    text = f"only {content['n_used']} of {total} mapolas agree with the transform"
    yield from _below(Code.FEW_AGREE, share, text)


def _images(content: Mapping[str, Any]) -> Iterator[Finding]:
    """Test the share of images that show the ground of the mapolas."""
    compared = content.get("n_images_compared")
    if compared is None:
        return
    share = content["n_images"] / compared if compared else 0.0
    if share < _MATCHED_IMAGES:
        missing = content["images_not_matched"]
        named = f" (not {', '.join(missing[:_NAMED])}{' ...' * (len(missing) > _NAMED)})"
        text = (
            f"only {content['n_images']} of {compared} images show the relief that the lidar "
            f"measured there{named if missing else ''}"
        )
        yield Finding(Code.IMAGES_NOT_MATCHED, Severity.DOUBTFUL, text, share, _MATCHED_IMAGES)


def _observation_types(content: Mapping[str, Any]) -> Iterator[Finding]:
    """Test whether images and heights agree: for single mapolas, and in the rotation."""
    known = np.array(
        [entry.get("types_chi2", np.nan) for entry in content.get("per_mapola") or ()], dtype=float
    )
    known = known[np.isfinite(known)]
    ratio = float(np.sqrt(np.median(known) / special.chdtri(3, 0.5))) if len(known) else 0.0
    text = (
        f"images and heights give different positions of the mapolas, by {ratio:.1f} times their "
        "sigmas"
    )
    yield from _above(Code.IMAGES_DISAGREE, ratio, (_DOUBTFUL_TYPES, _REFUSED_TYPES), text)
    turn = np.array(content.get("types_rotation_deg", np.nan), dtype=np.float64)
    sigma = np.array(content.get("types_rotation_sigma_deg", np.nan), dtype=np.float64)
    apart = float(np.max(np.abs(turn) / sigma))
    text = (
        f"the rotation by images differs from that by heights by {np.linalg.norm(turn):.2g} deg, "
        f"{apart:.1f} sigma"
    )
    yield from _above(Code.IMAGES_DISAGREE, apart, (_DOUBTFUL_APART, _REFUSED_APART), text)


def _heights(chi: FloatArray) -> Iterator[Finding]:
    """Test the height residuals against their stated sigmas."""
    known = chi[np.isfinite(chi)]
    if not len(known):
        return
    middle = float(np.median(known))
    text = f"the heights of lidar and SPC differ by {middle:.1f} times their stated sigmas"
    yield from _above(Code.HEIGHTS_DISAGREE, middle, (_DOUBTFUL_CHI, _REFUSED_CHI), text)


def _centers(content: Mapping[str, Any], limits: RegistrationLimits) -> Iterator[Finding]:
    """Test the estimated error of maplets' centres against that of files and settings."""
    estimated = content.get("maplet_sigma_m")
    if estimated is None:
        return
    landmarks = content.get("landmarks") or {}
    stated = max(limits.center_sigma_m, landmarks.get("own_sigma_m") or 0.0)
    ratio = float(estimated) / stated
    text = (
        f"the centres of maplets are off by {estimated:.2g} m each, {ratio:.1f} times the sigma of "
        f"their landmarks and [register] center_sigma_m ({stated:.2g} m)"
    )
    yield from _above(Code.CENTERS_DISAGREE, ratio, (_DOUBTFUL_CENTER, _REFUSED_CENTER), text)


def _scale(content: Mapping[str, Any], limits: RegistrationLimits) -> Iterator[Finding]:
    """Test the scale against its limit."""
    off = abs(content["scale"] - 1.0) - _BEYOND * content["scale_sigma"]
    severity = _severity(off - limits.scale, (_ABSURD - 1.0) * limits.scale)
    if severity is not None:
        text = (
            f"the scale of {content['scale']:.5f} lies further from 1 than "
            f"[register] max_scale_change = {limits.scale:g}"
        )
        yield Finding(Code.LARGE_SCALE, severity, text, content["scale"] - 1.0, limits.scale)


def _rotation(content: Mapping[str, Any], limits: RegistrationLimits) -> Iterator[Finding]:
    """Test the rotation against its limit."""
    turn = np.array(content["rotation_deg"], dtype=np.float64)
    sigma = float(np.max(content["rotation_sigma_deg"]))
    angle = float(np.linalg.norm(turn))
    if angle - _BEYOND * sigma > limits.rotation_deg:
        text = (
            f"the rotation of {angle:.2f} deg is larger than "
            f"[register] max_rotation_deg = {limits.rotation_deg:g}"
        )
        yield Finding(Code.LARGE_ROTATION, Severity.DOUBTFUL, text, angle, limits.rotation_deg)


def _strain(content: Mapping[str, Any]) -> Iterator[Finding]:
    """Test shear and non-uniform scale, which the model lacks."""
    strain = (content.get("tests") or {}).get("strain") or {}
    chance = strain.get("p_value")
    if chance is not None and chance < _STRAIN_CHANCE:
        largest = float(np.max(np.abs(strain["strain"])))
        text = (
            f"lidar and SPC differ by a shear or non-uniform scale of {largest:.2g} (probability "
            f"by chance {chance:.0e})"
        )
        yield Finding(Code.STRAIN, Severity.DOUBTFUL, text, chance, _STRAIN_CHANCE)


def _above(code: Code, value: float, limits: tuple[float, float], text: str) -> Iterator[Finding]:
    """Yield a finding if a value exceeds the limit of doubtful results, or that of refused ones."""
    severity = _severity(value - limits[0], limits[1] - limits[0])
    if severity is not None:
        yield Finding(code, severity, text, value, limits[0])


def _below(code: Code, share: float, text: str) -> Iterator[Finding]:
    """Yield a finding if a share of the mapolas lies below its limits."""
    severity = _severity(_DOUBTFUL_SHARE - share, _DOUBTFUL_SHARE - _REFUSED_SHARE)
    if severity is not None:
        yield Finding(code, severity, text, share, _DOUBTFUL_SHARE)


def _severity(excess: float, to_refusal: float) -> Severity | None:
    """Return the severity of exceeding a limit by `excess`; None if it is not exceeded."""
    if not excess > 0.0:
        return None
    return Severity.REFUSED if excess > to_refusal else Severity.DOUBTFUL
