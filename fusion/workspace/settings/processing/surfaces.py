"""Tables of the settings of stages that make surfaces."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fusion.workspace.settings.ranges import (
    Cells,
    Count,
    Fraction,
    Gsd,
    Latitude,
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
    Turn,
)
from fusion.workspace.settings.table import Table


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


class FuseSettings(Table):
    """[fuse]: lidar heights as constraints on the integration of slopes."""

    loss: Literal["l2", "huber", "cauchy"] = Field(
        default="huber", description="loss function of the lidar constraints"
    )
    constraint_fraction: Fraction = Field(
        default=1.0, description="share of the lidar heights used (a random subset below 1)"
    )
    seed: Seed = Field(default=1, description="of the random subset")
    stereo: bool = Field(
        default=True,
        description="whether the displacement of ground in images by its height determines heights",
    )
    fill_sigma_m: Sigma = Field(
        default=1.0,
        description="sigma of a height that comes from the shape alone, without lidar",
    )
    light: Literal["auto", "images", "sun", "none"] = Field(
        default="auto",
        description="where SPC observed slopes: by the frames of its images, by their Sun alone, "
        "or everywhere (none); auto: images, if maplets lie in three or more",
    )


class LithosSettings(Table):
    """[lithos]: slopes, albedo and heights of maplets from the brightness of their images."""

    constraints: list[
        Literal["shape", "overlaps", "coarser", "lidar", "returns", "limbs", "maps"]
    ] = Field(
        default=["shape"],
        max_length=20,
        description="heights that constrain the integration: the shape, overlapping maplets of "
        "about the same GSD, coarser ones, registered mapolas (lidar) or the registered returns "
        "themselves, the shape's limbs in images, maps",
    )
    shape_sigma_m: SigmaOrNone = Field(
        default=0.0,
        description="sigma of the shape's heights; 0: found from images, the GSD of a maplet at "
        "most, or a tenth of the side of its facets",
    )
    maps: list[Text] = Field(
        default=[],
        max_length=1000,
        description="maps and terrain models that constrain: GeoTIFF, .MAP, FITS of a release; "
        "paths relative to the workspace",
    )
    map_sigma_m: SigmaOrNone = Field(
        default=0.0, description="sigma of their heights where a file states none; 0: refused"
    )
    constraint_fraction: Annotated[float, Span(1e-6, 1.0)] = Field(
        default=1.0,
        description="share of the constraining heights that counts in a round, drawn anew each "
        "round; 1: all, by their sigmas",
    )
    seed: Seed = Field(default=1, description="of the random subset")
    stereo: bool = Field(
        default=True,
        description="whether the displacement of ground in images by its height determines heights",
    )
    max_images: Annotated[int, Span(2, 10_000)] = Field(
        default=50, description="most images of a maplet"
    )
    secondary_light: Texts = Field(
        default=[],
        description="images that also count where the Sun does not light the ground, below their "
        "lower threshold: lit ground around it is its light",
    )
    photometry: Text = Field(
        default="",
        description="photometric function with its parameters; empty: that of [register]",
    )
    psf_px: Annotated[float, Span(0.0, 10.0)] = Field(
        default=0.0, description="sigma of the optics' point spread, pixels"
    )
    image_blur: Text = Field(
        default="",
        description="table (CSV) of the point spread and smear of images, for those that differ; "
        "a path relative to the workspace",
    )
    albedo_sigma: Annotated[float, Span(1e-6, 1.0)] = Field(
        default=0.2, description="sigma with which the relative albedo is drawn to its mean"
    )
    albedo_step_sigma: Annotated[float, Span(1e-6, 1.0)] = Field(
        default=0.035,
        description="expected scatter of the relative albedo about the mean of the cells around",
    )
    albedo_mean: Literal["1", "0.5"] = Field(
        default="1",
        description="mean relative albedo of a maplet; the largest is 2 with 1, and 2.55 with 0.5",
    )
    albedo_range: Annotated[float, Span(0.0, 1000.0)] = Field(
        default=0.0,
        description="largest distance of an albedo from the median, in its robust standard "
        "deviations over the maplet; 0: none",
    )
    slope_sigma: Annotated[float, Span(1e-6, 10.0)] = Field(
        default=0.3, description="expected scatter of slopes about those of the start"
    )
    rounds: Annotated[int, Span(1, 1000)] = Field(
        default=12, description="most rounds of each of three GSDs, coarse to fine"
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
    stereo: bool = Field(
        default=True,
        description="whether the displacement of ground in images by its height determines heights",
    )
    max_gsd_m: Gsd = Field(default=0.0, description="coarser maplets are left out; 0: none")
    max_distance_m: Size = Field(
        default=0.0, description="heights further from the shape are left out; 0: none"
    )
    max_gap: Annotated[int, Span(0, 500)] = Field(
        default=3, description="widest gap in the returns that is filled, cells"
    )


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
