"""Tables of the settings: the keys of each stage, with defaults, limits and meanings."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from fusion.verdict import Code
from fusion.workspace.settings.ranges import (
    Angle,
    Cells,
    Count,
    Fraction,
    Gsd,
    Latitude,
    Milliradians,
    NaifNumber,
    Offset,
    Rate,
    Reach,
    Relative,
    Seconds,
    Seed,
    Sigma,
    SigmaDegrees,
    SigmaOrNone,
    Sigmas,
    Size,
    Span,
    Text,
    Texts,
    Tilt,
    Turn,
)

Tilts = Annotated[list[Tilt], Field(min_length=3, max_length=3)]
Offsets = Annotated[list[Offset], Field(min_length=3, max_length=3)]
TwoTilts = Annotated[list[Tilt], Field(min_length=2, max_length=2)]
TwoRelative = Annotated[list[Relative], Field(min_length=2, max_length=2)]


class Table(BaseModel):
    """One table of the settings; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class BodySettings(Table):
    """[body]: the body and its shape model."""

    name: str = Field(
        default="body",
        pattern=r"^[!-~]([ -~]{0,38}[!-~])?$",  # FITS and SPICE take ASCII only
        description="name of the body (and of its body-fixed frame), in ASCII",
    )
    mean_radius_m: Size = Field(default=0.0, description="mean radius; 0: that of the shape")
    shape: Text = Field(
        default="", description="file in SHAPEFILES; empty: the only one, or SHAPE.TXT"
    )
    shape_unit: Literal["km", "m"] = Field(
        default="km", description="unit of an OBJ or PLY shape; ICQ is in km"
    )
    faces_from: Literal[1, 0] = Field(
        default=1, description="number of the first vertex in the faces of an OBJ"
    )
    icq_edges: Literal["mean", "first", "refuse"] = Field(
        default="mean",
        description="vertex of an ICQ whose labels differ: their mean, the first, or refuse it",
    )


class ImportSettings(Table):
    """[import]: how lidar files are read."""

    sigma_range_m: SigmaOrNone = Field(
        default=0.0,
        description="standard deviation of one range where the file states none; 0: unknown",
    )
    range_tolerance_m: SigmaOrNone = Field(
        default=0.0,
        description="returns whose point and range differ by more are rejected; 0: by the format",
    )
    min_radius_m: Size = Field(
        default=0.0, description="returns nearer to the centre of the body are rejected"
    )
    max_radius_m: Size = Field(
        default=0.0,
        description="returns further from it are rejected; both 0: by the shape",
    )
    chunk: Annotated[int, Span(1000, 100_000_000)] = Field(
        default=1_000_000, description="returns held in memory at a time"
    )


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


class MapolaSettings(Table):
    """[mapolas]: gridding of returns."""

    source: Literal["maplets", "cover"] = Field(
        default="maplets",
        description="centres of mapolas: those of the SPC maplets, or a covering of the shape",
    )
    gsd_m: Gsd = Field(default=0.0, description="ground sample distance; 0: that of the maplet")
    half_size: Cells = Field(default=0, description="q of the (2q+1)² grid; 0: that of the maplet")
    overlap: Annotated[float, Span(0.0, 0.8)] = Field(
        default=0.3, description="overlap of neighbours in a covering, in half sides"
    )
    min_count: Count = Field(default=1, description="fewest returns in a cell with a height")
    min_coverage: Fraction = Field(
        default=0.1, description="least share of cells with a height in a mapola"
    )
    outlier_k: Sigmas = Field(
        default=5.0, description="returns off by more sigmas are rejected as outliers"
    )
    trajectory: Literal["reference", "spc"] = Field(
        default="reference",
        description="geolocates the returns: that of their files, or from the states of images",
    )
    max_gap_s: Seconds = Field(
        default=600.0,
        description="longest gap that is interpolated, between states of images or in kernels",
    )
    adjust: bool = Field(
        default=True, description="whether scans are displaced so that they agree in their overlaps"
    )
    adjust_sigma_m: Sigma = Field(
        default=0.05,
        description="expected displacement of a scan per axis; its size is estimated",
    )
    adjust_sigma_deg: SigmaDegrees = Field(
        default=0.003, description="expected rotation of a scan; its size is estimated"
    )
    adjust_arc_s: Annotated[float, Span(10.0, 1e10)] = Field(
        default=600.0, description="longer scans are displaced in arcs of at most this"
    )


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
        description="photometric function of the rendering",
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


class FuseSettings(Table):
    """[fuse]: lidar heights as constraints on the integration of slopes."""

    loss: Literal["l2", "huber", "cauchy"] = Field(
        default="huber", description="loss function of the lidar constraints"
    )
    constraint_fraction: Fraction = Field(
        default=1.0, description="share of the lidar heights used (a random subset below 1)"
    )
    seed: Seed = Field(default=1, description="of the random subset")
    fill_sigma_m: Sigma = Field(
        default=1.0,
        description="sigma of a height that comes from the shape alone, without lidar",
    )
    light: Literal["auto", "images", "sun", "none"] = Field(
        default="auto",
        description="where SPC observed slopes: by the frames of its images, by their Sun alone, "
        "or everywhere (none); auto: images, if maplets lie in three or more",
    )


class BigmapSite(Table):
    """One entry of [bigmap] sites."""

    name: str = Field(pattern=r"^[A-Za-z0-9_]{1,6}$")
    latitude_deg: Latitude
    longitude_deg: Turn = 0.0
    size_m: Size = 0.0
    gsd_m: Gsd = 0.0


POLES = [
    BigmapSite(name="NPOLE", latitude_deg=90.0),
    BigmapSite(name="SPOLE", latitude_deg=-90.0),
]


class BigmapSettings(Table):
    """[bigmap]: maplets, returns and fused maplets combined over larger squares."""

    sites: list[BigmapSite] = Field(
        default=POLES,
        max_length=1000,
        description="places; size_m 0: half the mean radius; gsd_m 0: that of the maplets",
    )
    constraint_fraction: Fraction = Field(default=1.0, description="share of averaged heights used")
    seed: Seed = Field(default=1, description="of the random subset")
    max_gsd_m: Gsd = Field(default=0.0, description="coarser maplets are left out; 0: none")
    max_distance_m: Size = Field(
        default=0.0, description="heights further from the shape are left out; 0: none"
    )
    max_gap: Annotated[int, Span(0, 500)] = Field(
        default=3, description="widest gap in the returns that is filled, cells"
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


class ReleaseSettings(Table):
    """[release]: products to publish."""

    products: list[Literal["map", "fits", "geotiff", "obj", "ply"]] = Field(
        default=["map", "fits", "geotiff", "obj", "ply"],
        max_length=20,
        description="formats written",
    )
    version: Annotated[int, Span(1, 999)] = Field(
        default=1, description="version of the products, in their names"
    )
