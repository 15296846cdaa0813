"""Tables of the settings that locate returns: the body's rotation, and SPICE kernels."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from fusion.workspace.settings.ranges import (
    Latitude,
    NaifNumber,
    Offset,
    Rate,
    Relative,
    Span,
    Text,
    Texts,
    Tilt,
    Turn,
)
from fusion.workspace.settings.table import Table

Tilts = Annotated[list[Tilt], Field(min_length=3, max_length=3)]
Offsets = Annotated[list[Offset], Field(min_length=3, max_length=3)]
TwoTilts = Annotated[list[Tilt], Field(min_length=2, max_length=2)]
TwoRelative = Annotated[list[Relative], Field(min_length=2, max_length=2)]


class SpinSettings(Table):
    """[spin]: the body's rotation in the lidar files, and corrections to it before use.

    Constants are those of a PCK with J2000 as its epoch. A rotation with periodic terms
    (``NUT_PREC_*``) cannot be stated here: [spice] takes the corrected PCK.
    """

    pole_ra_deg: Turn = Field(
        default=0.0,
        description="right ascension of the pole (J2000) with which lidar files were geolocated",
    )
    pole_dec_deg: Latitude = Field(default=90.0, description="declination of that pole")
    meridian_deg: Turn = Field(
        default=0.0, description="angle of the prime meridian at J2000 (W0) in those files"
    )
    rate_deg_per_day: Rate = Field(
        default=0.0, description="rotation of the body in those files (W1); 0: not stated"
    )
    quadratic_deg_per_day2: Rate = Field(
        default=0.0,
        description="coefficient of the squared days in that angle (W2) in those files",
    )
    pole_ra_rate_deg_per_century: Rate = Field(
        default=0.0, description="motion of the pole in those files (second number of POLE_RA)"
    )
    pole_dec_rate_deg_per_century: Rate = Field(
        default=0.0, description="the same for its declination (second number of POLE_DEC)"
    )
    shift_pole_ra_deg: Turn = Field(default=0.0, description="corrected minus stated")
    shift_pole_dec_deg: Tilt = Field(default=0.0, description="corrected minus stated")
    shift_meridian_deg: Turn = Field(default=0.0, description="corrected minus stated")
    shift_rate_deg_per_day: Rate = Field(default=0.0, description="corrected minus stated")
    shift_quadratic_deg_per_day2: Rate = Field(default=0.0, description="corrected minus stated")
    shift_pole_ra_rate_deg_per_century: Rate = Field(
        default=0.0, description="corrected minus stated"
    )
    shift_pole_dec_rate_deg_per_century: Rate = Field(
        default=0.0, description="corrected minus stated"
    )

    @model_validator(mode="after")
    def _pole_in_the_sky(self) -> Self:
        """Refuse a corrected pole beyond ±90°: it would not move as the settings state."""
        if abs(self.pole_dec_deg + self.shift_pole_dec_deg) > 90.0:
            raise PydanticCustomError(
                "range",
                "pole_dec_deg and shift_pole_dec_deg should add up to -90 to 90; past the pole "
                "the right ascension is 180 deg further",
            )
        return self


class SpiceSettings(Table):
    """[spice]: kernels to geolocate returns again before they are used; none: as imported."""

    kernels: Texts = Field(
        default=[],
        description="SPK, PCK; CK, FK and SCLK for the pointing; paths relative to the workspace",
    )
    prime_meridian: Text = Field(
        default="",
        description="which of them is used if several state the body's rotation: pole, prime "
        "meridian, their rates and periodic terms",
    )
    spacecraft: Text = Field(default="", description="its name or NAIF number")
    body: NaifNumber = Field(default=0, description="NAIF number of the body")
    frame: Text = Field(
        default="", description="frame of the lidar; empty: beams keep their body-fixed direction"
    )
    reference: Texts = Field(
        default=[], description="kernels of the pointing with which the lidar files were geolocated"
    )
    reference_prime_meridian: Text = Field(
        default="", description="as prime_meridian, for the kernels in reference"
    )
    pointing_tolerance_s: Annotated[float, Span(0.0, 60.0)] = Field(
        default=1e-3,
        description="times this close to the end of a CK segment use the pointing there, with an "
        "error of up to the rotation rate of the spacecraft times this (1.3 mrad/s, 0.15 s: "
        "0.2 mrad, 1 m at 5 km)",
    )
    boresight_deg: Tilts = Field(
        default=[0.0, 0.0, 0.0], description="rotation of the beams about the axes of the frame"
    )
    pupil_m: Offsets = Field(
        default=[0.0, 0.0, 0.0], description="shift of the pupil along the axes of the frame"
    )
    mirror_deg: TwoTilts = Field(
        default=[0.0, 0.0],
        description="added to azimuth (from Z of the frame to X) and elevation (to Y) of the beams",
    )
    mirror_scale: TwoRelative = Field(
        default=[0.0, 0.0], description="relative correction of azimuth and elevation"
    )

    range_m: Offset = Field(
        default=0.0,
        description="added to the ranges (another reference point); needs no kernels",
    )

    @property
    def mounting(self) -> tuple[float, ...]:
        """All numbers that need a frame."""
        return (*self.boresight_deg, *self.pupil_m, *self.mirror_deg, *self.mirror_scale)
