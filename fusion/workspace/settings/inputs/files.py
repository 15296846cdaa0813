"""Tables of the settings on what is read: the body with its shape, and lidar files."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fusion.workspace.settings.ranges import SigmaOrNone, Size, Span, Text
from fusion.workspace.settings.table import Table


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
