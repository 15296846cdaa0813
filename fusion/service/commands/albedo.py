"""What ``spcola spc albedo`` does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import typer

from fusion.service.commands.lithos import (
    BlurTable,
    OnlyMaplets,
    Photometry,
    PointSpread,
    WithinPlace,
    path_text,
)
from fusion.service.commands.site import Done, Site

__all__ = ["AlbedoCommandOptions", "solve_albedos"]


@dataclass(frozen=True)
class AlbedoCommandOptions:
    """Options of ``spcola spc albedo``."""

    ground: Annotated[
        Literal["maplets", "mapolas", "bigmaps"],
        typer.Option(
            "--of",
            help="What has the albedo: the maplets; registered mapolas, which become maplets; or "
            "the bigmaps of the solution's fused or solved maplets.",
        ),
    ] = "maplets"
    only: OnlyMaplets = None
    within: WithinPlace = ""
    centers: Annotated[
        Literal["images", "registration"],
        typer.Option(
            help="Where mapolas lie: as images show each of them, or as the registration has them."
        ),
    ] = "images"
    letters: Annotated[
        str,
        typer.Option(
            metavar="AB",
            help="First two letters of the names of mapolas as maplets, AB0001 to ABZZZZ; by "
            "default the first of AA, AB, … with which no name begins.",
        ),
    ] = ""
    accept: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CODE", help="Use mapolas of a doubtful registration with this finding."
        ),
    ] = None
    max_images: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            max=10_000,
            help="Most images of a maplet, or of as much of a bigmap: [lithos] max_images.",
        ),
    ] = None
    photometry: Photometry = ""
    psf: PointSpread = None
    image_blur: BlurTable = None
    albedo_sigma: Annotated[
        float,
        typer.Option(
            metavar="SHARE", min=1e-6, max=10.0, help="Expected scatter of the relative albedo."
        ),
    ] = 0.2
    albedo_mean: Annotated[
        Literal["1", "0.5"] | None,
        typer.Option(
            help="Mean albedo of each surface: 1 (and 2 at most) or 0.5 (and 2.55 at most): "
            "[lithos] albedo_mean."
        ),
    ] = None
    albedo_range: Annotated[
        float | None,
        typer.Option(
            metavar="SIGMAS",
            min=0.0,
            max=1000.0,
            help="Largest distance of an albedo from the median, in its standard deviations; 0: "
            "none. [lithos] albedo_range.",
        ),
    ] = None
    slope_error: Annotated[
        float,
        typer.Option(
            metavar="SLOPE",
            min=0.0,
            max=10.0,
            help="Standard deviation of the slopes of the ground, for the sigma of the albedo.",
        ),
    ] = 0.08
    rounds: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=1000, help="Most rounds: [lithos] rounds."),
    ] = None
    name: Annotated[
        str,
        typer.Option("--as", metavar="NAME", help="Name of the new solution, else albedo-1, ..."),
    ] = ""


def solve_albedos(site: Site, given: AlbedoCommandOptions) -> Done:
    """Solve albedo on known topography: of maplets, mapolas or bigmaps."""
    from fusion.pipeline import Subset
    from fusion.service.commands.stages import accepting
    from fusion.stages.albedo import AlbedoWork, albedo_of_bigmaps, albedo_solution
    from spcola.errors import SettingsError

    changed = {
        "max_images": given.max_images,
        "photometry": given.photometry or None,
        "psf_px": given.psf,
        "image_blur": path_text(given.image_blur),
        "albedo_mean": given.albedo_mean,
        "albedo_range": given.albedo_range,
        "rounds": given.rounds,
    }
    workspace = site.open()
    settings = accepting(workspace.settings(), given.accept or ()).with_table(
        "lithos", **{key: value for key, value in changed.items() if value is not None}
    )
    work = AlbedoWork.of(
        settings,
        given.ground,
        Subset.of(given.only or (), given.within),
        centers=given.centers,
        letters=given.letters,
        albedo_sigma=given.albedo_sigma,
        slope_error=given.slope_error,
    )
    if given.ground == "bigmaps":
        if given.name:
            raise SettingsError("bigmaps stay in their solution", "--as", "leave it out")
        result = albedo_of_bigmaps(workspace, work, site.executor, site.progress, wait=site.wait)
    else:
        result = albedo_solution(
            workspace, given.name, work, site.executor, site.progress, job=site.job
        )
    return Done({"workspace": workspace.root, **result.as_dict()}, result.lines())
