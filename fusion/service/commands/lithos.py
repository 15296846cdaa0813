"""What ``spcola spc lithos`` and ``spcola fuse --from images`` do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fusion.service.commands.site import Done, Site

if TYPE_CHECKING:
    from fusion.stages.lithos import LithosOptions
    from fusion.workspace import Workspace

__all__ = ["ImageFusionOptions", "LithosCommandOptions", "fuse_images", "solve_maplets"]


OnlyMaplets = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="This one; repeat it for several. Else all."),
]
WithinPlace = Annotated[
    str,
    typer.Option(
        metavar="LAT,LON,RADIUS_M",
        help="Those whose centre lies within so many metres of a place, degrees.",
    ),
]
Photometry = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Photometric function with its parameters, as spcola photometry fit prints it: "
        "[lithos] photometry; by default that of [register].",
    ),
]
PointSpread = Annotated[
    float | None,
    typer.Option(
        metavar="PIXELS",
        min=0.0,
        max=10.0,
        help="Sigma of the optics' point spread: [lithos] psf_px.",
    ),
]
BlurTable = Annotated[
    Path | None,
    typer.Option(
        "--image-blur",
        metavar="FILE",
        help="Table (CSV) of the point spread and smear of images, for those that differ from "
        "--psf: [lithos] image_blur.",
    ),
]


@dataclass(frozen=True)
class LithosCommandOptions:
    """Options of ``spcola spc lithos``."""

    only: OnlyMaplets = None
    within: WithinPlace = ""
    start: Annotated[
        Literal["maplet", "shape"],
        typer.Option(help="Heights of the first round: the solution's maplet, or its shape."),
    ] = "maplet"
    constraint: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND",
            help="Heights that constrain the integration: shape, overlaps (of maplets of about "
            "the same GSD), coarser (maplets), lidar (of registered mapolas), returns (registered "
            "ones, each at its place), limbs (of the shape in images), maps (of [lithos] maps), or "
            "none. Repeat it for several. By default [lithos] constraints: the shape.",
        ),
    ] = None
    shape_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            min=1e-6,
            max=1e5,
            help="Sigma of the shape's heights, [lithos] shape_sigma_m. Else images show it, the "
            "GSD of a maplet at most, or a tenth of the side of its facets.",
        ),
    ] = None
    map: Annotated[
        list[Path] | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="A map or terrain model whose heights constrain too, in the solution's frame: "
            "GeoTIFF, .MAP, FITS of a release. Repeat it for several: [lithos] maps.",
        ),
    ] = None
    map_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            min=1e-6,
            max=1e5,
            help="Sigma of the heights of maps that state none: [lithos] map_sigma_m.",
        ),
    ] = None
    stereo: Annotated[
        bool | None,
        typer.Option(
            "--stereo/--no-stereo",
            help="Whether the displacement of ground in images by its height determines heights, "
            "or slopes and constraints alone: [lithos] stereo.",
        ),
    ] = None
    constraint_fraction: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            min=1e-6,
            max=1.0,
            help="Share of the constraining heights that counts in a round, drawn anew each "
            "round: [lithos] constraint_fraction.",
        ),
    ] = None
    secondary_light: Annotated[
        list[str] | None,
        typer.Option(
            metavar="IMAGE",
            help="An image that also counts where the Sun does not light the ground, and lit "
            "ground around it does: pixels below its lower threshold. Repeat it for several: "
            "[lithos] secondary_light.",
        ),
    ] = None
    max_images: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=2, max=10_000, help="Most images of a maplet: [lithos] max_images."
        ),
    ] = None
    photometry: Photometry = ""
    psf: PointSpread = None
    image_blur: BlurTable = None
    albedo_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            min=1e-6,
            max=1.0,
            help="Sigma with which the relative albedo is drawn to its mean: [lithos] "
            "albedo_sigma.",
        ),
    ] = None
    rounds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            max=1000,
            help="Most rounds of each of three GSDs: [lithos] rounds.",
        ),
    ] = None
    name: Annotated[
        str,
        typer.Option("--as", metavar="NAME", help="Name of the new solution, else lithos-1, ..."),
    ] = ""


@dataclass(frozen=True)
class ImageFusionOptions:
    """Options of ``spcola fuse --from images``."""

    only: OnlyMaplets = None
    within: WithinPlace = ""
    accept: Annotated[
        list[str] | None,
        typer.Option(metavar="CODE", help="A finding of a doubtful registration that is accepted."),
    ] = None
    name: Annotated[
        str,
        typer.Option("--as", metavar="NAME", help="Name of the new solution, else spcola-1, ..."),
    ] = ""


def solve_maplets(site: Site, given: LithosCommandOptions) -> Done:
    """Make a solution whose maplets come from their images."""
    from fusion.pipeline import Subset
    from fusion.stages.lithos import LithosOptions

    constraints = _kinds(given.constraint)
    changed = {
        "shape_sigma_m": given.shape_sigma,
        "map_sigma_m": given.map_sigma,
        "constraint_fraction": given.constraint_fraction,
        "stereo": given.stereo,
        "secondary_light": given.secondary_light,
        "max_images": given.max_images,
        "photometry": given.photometry or None,
        "psf_px": given.psf,
        "image_blur": path_text(given.image_blur),
        "albedo_sigma": given.albedo_sigma,
        "rounds": given.rounds,
    }
    workspace = site.open()
    settings = workspace.settings().with_table(
        "lithos", **{key: value for key, value in changed.items() if value is not None}
    )
    subset = Subset.of(given.only or (), given.within)
    options = LithosOptions.of(
        settings,
        subset,
        start=given.start,
        constraints=constraints,
        maps=[path.resolve() for path in given.map or ()],
        root=workspace.root,
    )
    return _made(site, workspace, given.name, options)


def fuse_images(site: Site, given: ImageFusionOptions) -> Done:
    """Make a solution whose maplets come from their images, lidar, shape and overlaps at once.

    Limbs and maps constrain it too where the settings ask for them.
    """
    from fusion.pipeline import Subset
    from fusion.service.commands.stages import accepting
    from fusion.stages.lithos import ConstraintKind, LithosOptions, Purpose, lidar_kind

    workspace = site.open()
    settings = accepting(workspace.settings(), given.accept or ())
    asked = settings.lithos.constraints
    of_lidar = [kind for kind in (ConstraintKind.LIDAR, ConstraintKind.RETURNS) if kind in asked]
    kinds = [
        ConstraintKind.OVERLAPS,
        ConstraintKind.COARSER,
        *(of_lidar or [lidar_kind(workspace)]),
        *([ConstraintKind.SHAPE] if workspace.has_shape() else []),
        *(kind for kind in (ConstraintKind.LIMBS, ConstraintKind.MAPS) if kind in asked),
    ]
    options = LithosOptions.of(
        settings,
        Subset.of(given.only or (), given.within),
        constraints=kinds,
        root=workspace.root,
        purpose=Purpose.SPCOLA,
    )
    return _made(site, workspace, given.name, options)


def path_text(path: Path | None) -> str | None:
    """Return the path of a file as settings name it, in whatever folder the program runs."""
    return None if path is None else str(path.resolve())


def _made(site: Site, workspace: Workspace, name: str, options: LithosOptions) -> Done:
    """Make the solution."""
    from fusion.stages.lithos import lithos_solution

    result = lithos_solution(workspace, name, options, site.executor, site.progress, job=site.job)
    return Done({"workspace": workspace.root, **result.as_dict()}, result.lines())


def _kinds(given: list[str] | None) -> list[str] | None:
    """Return the kinds of constraints that are asked for; None for those of the settings.

    Raises
    ------
    SettingsError
        If one is unknown.
    """
    from fusion.stages.lithos import ConstraintKind
    from spcola.errors import SettingsError

    if given is None:
        return None
    known = [str(kind) for kind in ConstraintKind]
    for one in given:
        if one not in [*known, "none"]:
            raise SettingsError(
                f"{one!r} is no kind of height",
                "--constraint",
                f"known are {', '.join(known)}, none",
            )
    return [one for one in given if one != "none"]
