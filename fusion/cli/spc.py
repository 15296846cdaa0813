"""``spcola spc``: what the SPC programs do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer

from fusion.cli.options import PanelCommand, WorkOptions, WorkspaceArgument, with_shared_options
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.service.commands.albedo import AlbedoCommandOptions, solve_albedos
from fusion.service.commands.lithos import LithosCommandOptions, solve_maplets
from fusion.service.commands.spc_register import RegisterCommandOptions, register_images
from fusion.service.commands.tiling import TileOptions, tile_maplets

app = typer.Typer(
    name="spc",
    help="Do what the SPC programs do.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.callback()
def _group() -> None:
    """Do what the SPC programs do."""


def tile(
    workspace: WorkspaceArgument,
    given: TileOptions,
    work: WorkOptions = WorkOptions(),
) -> None:
    """Make a solution with finer maplets, seeded from coarser ones or from the shape.

    Maplets are spread evenly over the body or a region; neighbours overlap. Each gets the heights
    and albedo of the finest coarser maplets there, by projection; where none reaches, the relief of
    the shape, bent to meet them. Ground that is left uncovered gets further maplets. Each has a
    .LMK with its images and overlaps. The solution that is read stays as it is.
    """
    show(*tile_maplets(work.site(workspace), given), as_json=work.as_json)


def register(
    workspace: WorkspaceArgument,
    given: RegisterCommandOptions = RegisterCommandOptions(),
    work: WorkOptions = WorkOptions(),
) -> None:
    """Make a solution in which the states of images fit the shape.

    Each image is compared with the shape as rendered at its state; pointing and position are
    changed until both look most alike, the position within its sigma. Their sigmas are written too:
    spc lithos needs them. An image that does not look like the shape keeps its state, and the
    result names it. image_states.json of the new solution has how far each moved. The solution that
    is read stays as it is.
    """
    show(*register_images(work.site(workspace), given), as_json=work.as_json)


def lithos(
    workspace: WorkspaceArgument,
    given: LithosCommandOptions = LithosCommandOptions(),
    work: WorkOptions = WorkOptions(),
) -> None:
    """Make a solution whose maplets are solved from their images.

    Slopes and albedo of each maplet follow from the brightness of all images that show it, and are
    integrated to heights; stereo and constraining heights are in the same equations. Images are
    moved to a fraction of a pixel within the uncertainty of their states. A maplet keeps its
    heights, and the result names it, if its images fit no better than before, or are too few and no
    precise height constrains it. photoclinometry.json of the new solution has residuals, shifts and
    outcomes. The solution that is read stays as it is; an interrupted command goes on where it was.
    """
    show(*solve_maplets(work.site(workspace), given), as_json=work.as_json)


def albedo(
    workspace: WorkspaceArgument,
    given: AlbedoCommandOptions = AlbedoCommandOptions(),
    work: WorkOptions = WorkOptions(),
) -> None:
    """Solve albedo on known topography: of maplets, mapolas or bigmaps.

    Heights and slopes stay as they are; only the albedo of each cell follows from the brightness of
    the images. Maplets get it in a new solution. Registered mapolas become maplets of a new
    solution, each where images show it, with a .LMK, so that they overlap and correlate with those
    from images. Bigmaps get it in bigmaps/albedo, as a whole. A companion .ASG has the sigma of
    each albedo; it is NaN where no image determines it. albedo.json has residuals and outcomes.
    """
    show(*solve_albedos(work.site(workspace), given), as_json=work.as_json)


COMMANDS: tuple[tuple[str, Callable[..., Any], str], ...] = (
    ("tile", tile, "spcola spc tile bennu --gsd 0.35 --within 56,43,20"),
    ("register", register, "spcola spc register bennu --as registered"),
    ("albedo", albedo, "spcola spc albedo bennu --of bigmaps"),
    ("lithos", lithos, "spcola spc lithos bennu --constraint shape --constraint returns"),
)

for _name, _function, _example in COMMANDS:
    app.command(_name, cls=PanelCommand, epilog=f"Example: {_example}")(
        guarded(with_shared_options(_function))
    )
