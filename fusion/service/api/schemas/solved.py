"""Answers about solutions from images: goodness of fit, and how maplets were solved."""

from __future__ import annotations

from typing import Any

from fusion.service.api.schemas.base import Form, Media, Number


class Outliers(Form):
    """Maplets or images that one should look at, and what to do."""

    code: str
    names: list[str]
    do: str


class Goodness(Form):
    """How images fit: brightness, and places; `codes` are those of the outliers among which it is.

    Numbers of images (of a maplet) or maplets (of an image) by how they fit.
    """

    name: str
    residual: Number
    noise_ratio: Number
    correlation: Number
    shift_px: Number
    shift_m: Number
    used: int
    not_seen: int
    contradicts: int
    sun_reversed: int
    codes: list[str]


class GoodnessOfMaplet(Goodness):
    """How a maplet was solved, and how its images fit."""

    outcome: str
    residual_start: Number
    sigma_m: Number
    height_m: Number
    albedo: Number


class SolvedIndex(Form):
    """Goodness of fit of each maplet and image of a solution from images."""

    solution: str
    options: dict[str, Any]
    outcomes: dict[str, int]
    residual_start: Number
    residual: Number
    shift_m: Number
    photometry_ratios: dict[str, Number] | None = None
    findings: list[Outliers]
    maplets: list[GoodnessOfMaplet]
    images: list[Goodness]


class SolvingRound(Form):
    """Residual before a round, and the changes in it."""

    gsd_m: Number
    residual: Number
    height_m: Number
    albedo: Number


class SolvedImage(Form):
    """How an image fits a maplet."""

    name: str
    fit: str
    scale: Number
    gradient: list[Number]
    shift_px: list[Number]
    residual: Number
    noise: Number
    correlation: Number
    pixels: int
    pixel_m: Number


class SolvedConstraint(Form):
    """How constraining heights fit a maplet."""

    name: str
    heights: int
    left_out: int
    residual_m: Number
    ratio: Number


class SolvedMaplet(Form):
    """How a maplet was solved from images."""

    solution: str
    name: str
    outcome: str
    reason: str
    residual_start: Number
    residual: Number
    noise_ratio: Number
    correlation: Number
    shift_px: Number
    shift_m: Number
    sigma_m: Number
    directions: list[Number]
    slope_sigma: Number = None
    left_over: Number = None
    albedo_sigma: Number = None
    undetermined_azimuth_deg: Number = None
    undetermined_agreement: Number = None
    around: list[str] | None = None
    light_ratio: Number
    shift_ratio: Number
    gsd_m: Number
    rounds: list[SolvingRound]
    images: list[SolvedImage]
    constraints: list[SolvedConstraint]
    findings: list[Outliers]
    residual_limit: Number


SOLVED_PICTURE = Media(("image/png",))
