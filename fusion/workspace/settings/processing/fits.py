"""Tables of the settings of the fits, and of the findings that are accepted."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from fusion.estimation.verdict import Code
from fusion.workspace.settings.ranges import (
    Angle,
    Fraction,
    Gsd,
    Milliradians,
    Reach,
    Seconds,
    Sigma,
    SigmaDegrees,
    SigmaOrNone,
    Sigmas,
    Size,
    Span,
    Text,
    Texts,
)
from fusion.workspace.settings.table import Table


class RegisterSettings(Table):
    """[register]: match of mapolas to the SPC surface, and the transform between their frames."""

    model: Literal["rigid", "similarity", "affine"] = Field(
        default="similarity", description="transform with 6, 7 or 12 parameters"
    )
    against: Literal["maplets", "bigmap", "shape"] = Field(
        default="maplets",
        description="SPC surface of the match: the maplet, its neighbours too, or the shape",
    )
    by: Literal["topography", "returns", "images", "both"] = Field(
        default="topography",
        description="what is matched: heights of mapolas, the returns themselves, images rendered "
        "from mapolas, or heights and images",
    )
    photometry: Text = Field(
        default="lunar-lambert",
        description="photometric function of the rendering: its name, and parameters such as "
        "minnaert k=0.6",
    )
    max_images: Annotated[int, Span(2, 1_000_000)] = Field(
        default=20, description="most images in which a mapola is matched"
    )
    capture_m: Reach = Field(default=2.0, description="largest horizontal displacement searched")
    min_coverage: Fraction = Field(
        default=0.3, description="least share of the grid that both surfaces cover"
    )
    min_correlation: Fraction = Field(
        default=0.5,
        description="least correlation of two surfaces, or of image and rendering, after the match",
    )
    center_sigma_m: Sigma = Field(
        default=0.05, description="expected error of a maplet's centre; its size is estimated"
    )
    landmarks: Literal["images", "sigmas", "ignore"] = Field(
        default="images",
        description="errors of maplets' centres: by shared images, or by the sigmas of their files",
    )
    scan_sigma_m: SigmaOrNone = Field(
        default=0.05,
        description="expected error that the returns of a scan share; its size is estimated",
    )
    reject_sigmas: Sigmas = Field(
        default=5.0, description="mapolas with larger residuals are rejected"
    )
    max_rotation_deg: Angle = Field(
        default=1.0, description="a larger rotation between the frames makes the result doubtful"
    )
    max_scale_change: Fraction = Field(
        default=0.01, description="a scale further from 1 makes the result doubtful"
    )
    apply: Text = Field(
        default="",
        description="registration.json whose transform is applied instead of a fit; path relative "
        "to the workspace; empty: fit",
    )
    inverse: bool = Field(
        default=False, description="whether that file transforms SPC to lidar coordinates"
    )


class ScaleSettings(Table):
    """[scale]: estimation of the scale, the centre and the prime meridian."""

    method: Literal["pairs", "shots"] = Field(
        default="pairs", description="paired bigmaps, or single shots against the shape"
    )
    trajectory: Literal["spc", "reference"] = Field(
        default="spc", description="geolocates the returns, for pairs and for shots"
    )
    size_m: Size = Field(
        default=0.0, description="side of the paired bigmaps; 0: by rule, 100 m at Bennu"
    )
    gsd_m: Gsd = Field(
        default=0.0, description="their ground sample distance; 0: by rule, 0.5 m at Bennu"
    )
    max_emission_deg: Angle = Field(
        default=60.0, description="largest emission angle of a pair's surface in its image"
    )
    max_incidence_deg: Angle = Field(
        default=85.0, description="largest incidence angle of a pair's surface in its image"
    )
    min_coverage: Fraction = Field(
        default=0.3, description="least share of the grid that both bigmaps cover"
    )
    min_correlation: Fraction = Field(
        default=0.5, description="least correlation of the two bigmaps after the match"
    )
    center_prior_m: Sigma = Field(default=10.0, description="prior sigma of the centre, each axis")
    meridian_prior_deg: SigmaDegrees = Field(
        default=1.0, description="prior sigma of the prime meridian"
    )
    pole_prior_deg: SigmaDegrees = Field(
        default=0.1, description="prior sigma of the pole, each direction"
    )
    range_bias_prior_m: Sigma = Field(
        default=0.03, description="prior sigma of a constant error of the measured range"
    )
    capture_m: Reach = Field(
        default=5.0, description="largest displacement of paired bigmaps that is searched"
    )
    single_sigma_m: Sigma = Field(
        default=0.1, description="expected error of one pair or shot; its size is estimated"
    )
    state_sigma_m: SigmaOrNone = Field(
        default=0.2,
        description="expected error of the state of an image or a scan; its size is estimated",
    )
    scan_sigma_m: SigmaOrNone = Field(
        default=0.05,
        description="pointing error of a scan on the ground, if states of images geolocate it",
    )
    maplet_sigma_m: SigmaOrNone = Field(
        default=0.05, description="error of a maplet's centre where its file states none"
    )
    day_sigma_m: SigmaOrNone = Field(
        default=0.02,
        description="expected error that the ranges of a day share; its size is estimated",
    )
    reject_sigmas: Sigmas = Field(
        default=5.0, description="pairs or shots with larger residuals are rejected"
    )
    footprint_mrad: Milliradians = Field(
        default=0.0, description="full width of the beam of single shots; 0: not known"
    )
    pointing_sigma_mrad: Milliradians = Field(
        default=0.0, description="pointing error of single shots, each of two axes; 0: not known"
    )
    max_shots: Annotated[int, Span(10, 10_000_000)] = Field(
        default=4_000, description="most single shots used; more are thinned evenly"
    )
    max_gap_s: Seconds = Field(
        default=600.0,
        description="longest gap that is interpolated, between states of images or in kernels",
    )


class AcceptSettings(Table):
    """[accept]: findings that the user has checked, so that the doubtful results are used."""

    codes: Texts = Field(
        default=[], description="codes of findings, as the stages print them; see --accept"
    )

    @field_validator("codes")
    @classmethod
    def _known(cls, codes: list[str]) -> list[str]:
        for code in codes:
            if code not in set(Code):
                raise ValueError(f"{code!r} is no code of a finding; known are {', '.join(Code)}")
        return codes
