"""What ``spcola spc tile`` does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import typer

from fusion.service.commands.site import Done, Site

__all__ = ["TileOptions", "tile_maplets"]


@dataclass(frozen=True)
class TileOptions:
    """Options of ``spcola spc tile``."""

    gsd: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            min=1e-6,
            max=1e6,
            help="GSD of the new maplets: that of the coarsest maplets there, or finer.",
        ),
    ]
    half_size: Annotated[
        int,
        typer.Option(metavar="Q", min=4, max=1000, help="A maplet has (2 Q + 1)² points."),
    ] = 49
    overlap: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            min=0.0,
            max=0.8,
            help="Share of a side that neighbours have in common, in the mean; full cover needs a "
            "third.",
        ),
    ] = 0.33
    within: Annotated[
        str,
        typer.Option(
            metavar="LAT,LON,RADIUS_M",
            help="Tile the ground within so many metres of a place, degrees; else the whole body.",
        ),
    ] = ""
    source: Annotated[
        Literal["maplets", "shape"],
        typer.Option(
            "--from",
            help="Heights come from coarser maplets, with the shape where none reaches; or from "
            "the shape alone.",
        ),
    ] = "maplets"
    replace: Annotated[
        bool,
        typer.Option(
            "--replace",
            help="The new solution has no longer the coarser maplets that lie wholly in the "
            "region.",
        ),
    ] = False
    sigma: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            min=1e-6,
            max=1e6,
            help="Sigma of the maplets' centres along each axis. By default that of the maplets "
            "that seed them, if stated; else the GSD, or a tenth of the side of the shape's facets "
            "if that is larger.",
        ),
    ] = None
    max_images: Annotated[
        int, typer.Option(metavar="N", min=1, max=10_000, help="Most images of a maplet.")
    ] = 50
    letters: Annotated[
        str,
        typer.Option(
            metavar="AB",
            help="First two letters of the names AB0001 to ABZZZZ; by default the first of AA, AB, "
            "… with which no name begins.",
        ),
    ] = ""
    name: Annotated[
        str,
        typer.Option("--as", metavar="NAME", help="Name of the new solution, else tiled-1, ..."),
    ] = ""
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Print how many maplets there would be and their disk, and make none."
        ),
    ] = False


def tile_maplets(site: Site, given: TileOptions) -> Done:
    """Make a solution with finer maplets, seeded from coarser ones or from the shape."""
    from fusion.pipeline import Subset
    from fusion.stages.tiling import TilingOptions, forecast_tiling, tile_solution

    options = TilingOptions(
        given.gsd,
        given.half_size,
        given.overlap,
        Subset.of(within=given.within),
        given.source,
        given.letters,
        given.replace,
        given.sigma,
        given.max_images,
    )
    workspace = site.open()
    if given.dry_run:
        found = forecast_tiling(workspace, given.name, options, site.progress)
        line = (
            f"{found['maplets']} maplets of {given.gsd:g} m, {found['disk_mb']:.1f} MB of disk, "
            "and a few more if some ground is hidden; nothing was written"
        )
        return Done({"dry_run": True, **found}, [line])
    result = tile_solution(
        workspace, given.name, options, site.executor, site.progress, job=site.job
    )
    return Done({"dry_run": False, **result.as_dict()}, result.lines())
