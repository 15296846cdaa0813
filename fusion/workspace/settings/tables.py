"""Tables of the settings: what each stage may be told, with defaults, limits and meanings."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from fusion.estimation.verdict import Code
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
    """One table of the settings; what it does not know is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class BodySettings(Table):
    """[body]: what the workspace is about."""

    name: str = Field(
        default="body",
        pattern=r"^[!-~]([ -~]{0,38}[!-~])?$",  # FITS and SPICE know ASCII only
        description="name of the body (and of its body-fixed frame), in ASCII",
    )
    mean_radius_m: Size = Field(default=0.0, description="mean radius; 0: that of the shape")
    shape: Text = Field(
        default="", description="file in SHAPEFILES; empty: the only one, or SHAPE.TXT"
    )
    shape_unit: Literal["km", "m"] = Field(
        default="km", description="of an OBJ or PLY shape; ICQ is in km"
    )
    faces_from: Literal[1, 0] = Field(
        default=1, description="by which number the faces of an OBJ name its first vertex"
    )
    icq_edges: Literal["mean", "first", "refuse"] = Field(
        default="mean",
        description="where labels of one vertex of an ICQ differ: at their mean, the first, or not",
    )


class ImportSettings(Table):
    """[import]: how lidar files are read."""

    sigma_range_m: SigmaOrNone = Field(
        default=0.0,
        description="standard deviation of one range where the file states none; 0: unknown",
    )
    range_tolerance_m: SigmaOrNone = Field(
        default=0.0,
        description="a return whose point and range disagree by more is rejected; 0: as the format",
    )
    min_radius_m: Size = Field(
        default=0.0, description="returns nearer to the centre of the body are rejected"
    )
    max_radius_m: Size = Field(
        default=0.0, description="returns further from it are rejected; both 0: by the shape"
    )
    chunk: Annotated[int, Span(1000, 100_000_000)] = Field(
        default=1_000_000, description="returns held in memory at a time"
    )


class SpinSettings(Table):
    """[spin]: the body's rotation, and what is to be corrected of it before returns are used.

    Constants are those of a PCK with J2000 as its epoch. A rotation with periodic terms
    (``NUT_PREC_*``) cannot be stated here: [spice] takes the corrected PCK.
    """

    pole_ra_deg: Turn = Field(
        default=0.0, description="pole in J2000 by which the lidar files were located"
    )
    pole_dec_deg: Latitude = Field(default=90.0, description="its declination")
    meridian_deg: Turn = Field(
        default=0.0, description="angle of the prime meridian at J2000 (W0), in those files"
    )
    rate_deg_per_day: Rate = Field(
        default=0.0, description="rotation of the body in those files (W1); 0: not stated"
    )
    quadratic_deg_per_day2: Rate = Field(
        default=0.0,
        description="coefficient of the squared days in that angle (W2), in those files",
    )
    pole_ra_rate_deg_per_century: Rate = Field(
        default=0.0, description="motion of the pole in those files (second number of POLE_RA)"
    )
    pole_dec_rate_deg_per_century: Rate = Field(
        default=0.0, description="the same of its declination (second number of POLE_DEC)"
    )
    shift_pole_ra_deg: Turn = Field(default=0.0, description="corrected less stated")
    shift_pole_dec_deg: Tilt = Field(default=0.0, description="corrected less stated")
    shift_meridian_deg: Turn = Field(default=0.0, description="corrected less stated")
    shift_rate_deg_per_day: Rate = Field(default=0.0, description="corrected less stated")
    shift_quadratic_deg_per_day2: Rate = Field(default=0.0, description="corrected less stated")
    shift_pole_ra_rate_deg_per_century: Rate = Field(
        default=0.0, description="corrected less stated"
    )
    shift_pole_dec_rate_deg_per_century: Rate = Field(
        default=0.0, description="corrected less stated"
    )

    @model_validator(mode="after")
    def _pole_in_the_sky(self) -> Self:
        """Refuse a corrected pole beyond ±90°: it would move by other than what is written."""
        if abs(self.pole_dec_deg + self.shift_pole_dec_deg) > 90.0:
            raise PydanticCustomError(
                "range",
                "pole_dec_deg and shift_pole_dec_deg should add up to -90 to 90; past the pole "
                "the right ascension is 180 deg further",
            )
        return self


class SpiceSettings(Table):
    """[spice]: kernels by which returns are located again before they are used; none: as read."""

    kernels: Texts = Field(
        default=[],
        description="SPK, PCK; CK, FK and SCLK for the pointing; paths from the workspace",
    )
    prime_meridian: Text = Field(
        default="",
        description="which of them counts where they disagree about the rotation of the body: "
        "pole, prime meridian, their rates and periodic terms",
    )
    spacecraft: Text = Field(default="", description="its name or NAIF number")
    body: NaifNumber = Field(default=0, description="NAIF number of the body")
    frame: Text = Field(
        default="", description="frame of the lidar; empty: beams keep their body-fixed direction"
    )
    reference: Texts = Field(
        default=[], description="kernels of the pointing by which the lidar files were located"
    )
    reference_prime_meridian: Text = Field(default="", description="as prime_meridian, for these")
    pointing_tolerance_s: Annotated[float, Span(0.0, 60.0)] = Field(
        default=1e-3,
        description="a time no further from the ends of a CK takes the pointing there: it errs by "
        "up to the rotation rate of the spacecraft times this (1.3 mrad/s, 0.15 s: 0.2 mrad, 1 m "
        "at 5 km)",
    )
    boresight_deg: Tilts = Field(
        default=[0.0, 0.0, 0.0], description="rotation of the beams about the axes of the frame"
    )
    pupil_m: Offsets = Field(
        default=[0.0, 0.0, 0.0], description="shift of the pupil along the axes of the frame"
    )
    mirror_deg: TwoTilts = Field(
        default=[0.0, 0.0],
        description="added to azimuth and elevation of the beams: from Z of the frame to X, to Y",
    )
    mirror_scale: TwoRelative = Field(
        default=[0.0, 0.0], description="relative correction of azimuth and elevation"
    )

    range_m: Offset = Field(
        default=0.0,
        description="added to the ranges: another reference point; needs no kernels",
    )

    @property
    def mounting(self) -> tuple[float, ...]:
        """All numbers that only mean something in a frame."""
        return (*self.boresight_deg, *self.pupil_m, *self.mirror_deg, *self.mirror_scale)


class MapolaSettings(Table):
    """[mapolas]: how returns become mapolas."""

    source: Literal["maplets", "cover"] = Field(
        default="maplets",
        description="centres: those of the SPC maplets, or a covering of the shape",
    )
    gsd_m: Gsd = Field(default=0.0, description="ground sample distance; 0: that of the maplet")
    half_size: Cells = Field(default=0, description="q of the (2q+1)² grid; 0: that of the maplet")
    overlap: Annotated[float, Span(0.0, 0.8)] = Field(
        default=0.3, description="of neighbours in a covering, in half sides"
    )
    min_count: Count = Field(default=1, description="returns that a cell needs to get a height")
    min_coverage: Fraction = Field(
        default=0.1, description="share of the cells that a mapola must hold to be kept"
    )
    outlier_k: Sigmas = Field(
        default=5.0, description="returns beyond this many sigmas do not enter"
    )
    trajectory: Literal["reference", "spc"] = Field(
        default="reference",
        description="by which returns are located: that of their files, or the states of images",
    )
    max_gap_s: Seconds = Field(
        default=600.0,
        description="longest gap interpolated over between states of images, or states and "
        "attitudes of kernels",
    )
    adjust: bool = Field(
        default=True, description="whether scans are moved to where they agree in their overlaps"
    )
    adjust_sigma_m: Sigma = Field(
        default=0.05, description="first guess of a scan's displacement, per axis; it is estimated"
    )
    adjust_sigma_deg: SigmaDegrees = Field(
        default=0.003, description="first guess of a scan's rotation; it is estimated"
    )
    adjust_arc_s: Annotated[float, Span(10.0, 1e10)] = Field(
        default=600.0, description="scans that last longer are moved in arcs of at most this"
    )


class RegisterSettings(Table):
    """[register]: how mapolas are matched to the SPC surface, and what is fitted."""

    model: Literal["rigid", "similarity", "affine"] = Field(
        default="similarity", description="6, 7 or 12 parameters"
    )
    against: Literal["maplets", "bigmap", "shape"] = Field(
        default="maplets",
        description="the surface that is matched: the maplet, its neighbours too, or shape",
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
        default=20, description="images in which a mapola is sought"
    )
    capture_m: Reach = Field(default=2.0, description="largest horizontal displacement searched")
    min_coverage: Fraction = Field(
        default=0.3, description="share of the grid that both surfaces hold"
    )
    min_correlation: Fraction = Field(
        default=0.5, description="of two surfaces, or of image and rendering, after the match"
    )
    center_sigma_m: Sigma = Field(
        default=0.05, description="expected error of a maplet's centre; its size is estimated"
    )
    landmarks: Literal["images", "sigmas", "ignore"] = Field(
        default="images",
        description="errors of maplets' centres: by the images that tie them, or as they state",
    )
    scan_sigma_m: SigmaOrNone = Field(
        default=0.05,
        description="expected error that the returns of a scan share; its size is estimated",
    )
    reject_sigmas: Sigmas = Field(
        default=5.0, description="mapolas further off than this are rejected"
    )
    max_rotation_deg: Angle = Field(
        default=1.0, description="a larger rotation between the frames makes the result doubtful"
    )
    max_scale_change: Fraction = Field(
        default=0.01, description="a scale further from 1 makes the result doubtful"
    )
    apply: Text = Field(
        default="",
        description="registration.json whose transform is taken and nothing fitted; path from the "
        "workspace; empty: fit",
    )
    inverse: bool = Field(
        default=False, description="whether that file takes SPC to lidar coordinates"
    )


class FuseSettings(Table):
    """[fuse]: how lidar heights enter the integration of slopes."""

    loss: Literal["l2", "huber", "cauchy"] = Field(
        default="huber", description="of lidar constraints"
    )
    constraint_fraction: Fraction = Field(
        default=1.0, description="share of the lidar heights used (a random subset below 1)"
    )
    seed: Seed = Field(default=1, description="of the random subset")
    fill_sigma_m: Sigma = Field(
        default=1.0,
        description="uncertainty of a height that comes from the shape alone, where no lidar tells",
    )
    light: Literal["auto", "images", "sun", "none"] = Field(
        default="auto",
        description="what says where SPC has slopes: the frames of its images, only their Sun, "
        "or nothing; auto: frames, if maplets lie in three or more",
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
    """[bigmap]: maplets, returns and fused maplets joined over larger squares."""

    sites: list[BigmapSite] = Field(
        default=POLES,
        max_length=1000,
        description="where; size_m 0: half the mean radius; gsd_m 0: the maplets'",
    )
    constraint_fraction: Fraction = Field(default=1.0, description="share of averaged heights used")
    seed: Seed = Field(default=1, description="of the random subset")
    max_gsd_m: Gsd = Field(default=0.0, description="coarser maplets are left out; 0: none is")
    max_distance_m: Size = Field(
        default=0.0, description="heights further from the shape are left out; 0: none is"
    )
    max_gap: Annotated[int, Span(0, 500)] = Field(
        default=3, description="widest gap of the returns that is bridged, cells"
    )


class ScaleSettings(Table):
    """[scale]: how the scale, the centre and the prime meridian are found."""

    method: Literal["pairs", "shots"] = Field(
        default="pairs", description="paired bigmaps, or single shots against the shape"
    )
    trajectory: Literal["spc", "reference"] = Field(
        default="spc", description="by which returns are located, for pairs and for shots"
    )
    size_m: Size = Field(
        default=0.0, description="side of the paired bigmaps; 0: by rule, 100 m at Bennu"
    )
    gsd_m: Gsd = Field(
        default=0.0, description="their ground sample distance; 0: by rule, 0.5 m at Bennu"
    )
    max_emission_deg: Angle = Field(
        default=60.0, description="largest angle of a pair's ground to its image"
    )
    max_incidence_deg: Angle = Field(
        default=85.0, description="largest angle of a pair's ground to the Sun of its image"
    )
    min_coverage: Fraction = Field(
        default=0.3, description="share of the grid that both bigmaps hold"
    )
    min_correlation: Fraction = Field(default=0.5, description="of the two bigmaps after the match")
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
        default=0.2, description="expected error of an image's state or a scan's; estimated"
    )
    scan_sigma_m: SigmaOrNone = Field(
        default=0.05, description="pointing error of a scan on the ground, where states locate it"
    )
    maplet_sigma_m: SigmaOrNone = Field(
        default=0.05, description="error of a maplet's centre where its file states none"
    )
    day_sigma_m: SigmaOrNone = Field(
        default=0.02, description="expected error that the ranges of a day share; estimated"
    )
    reject_sigmas: Sigmas = Field(
        default=5.0, description="pairs or shots further off than this are rejected"
    )
    footprint_mrad: Milliradians = Field(
        default=0.0, description="full width of the beam of single shots; 0: not known"
    )
    pointing_sigma_mrad: Milliradians = Field(
        default=0.0, description="error of their pointing, each of two axes; 0: not known"
    )
    max_shots: Annotated[int, Span(10, 10_000_000)] = Field(
        default=4_000, description="single shots used; more are thinned evenly"
    )
    max_gap_s: Seconds = Field(
        default=600.0,
        description="longest gap interpolated over between states of images, or states and "
        "attitudes of kernels",
    )


class AcceptSettings(Table):
    """[accept]: doubtful results that are used all the same, because somebody looked at them."""

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
    """[release]: what is published."""

    products: list[Literal["map", "fits", "geotiff", "obj", "ply"]] = Field(
        default=["map", "fits", "geotiff", "obj", "ply"],
        max_length=20,
        description="formats written",
    )
    version: Annotated[int, Span(1, 999)] = Field(
        default=1, description="of the products, in their names"
    )
