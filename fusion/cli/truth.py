"""``spcola truth``: make a synthetic mission, and assess models against it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import typer

from fusion.cli.options import (
    JsonOption,
    PanelCommand,
    WorkersOption,
    WorkspaceArgument,
    site_of,
    with_shared_options,
)
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.service.commands.assessment import AssessOptions, assess_models

app = typer.Typer(
    name="truth",
    help="Make a synthetic mission; assess models against it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@dataclass(frozen=True)
class MissionOptions:
    """Options that change a preset."""

    panel: ClassVar[str] = "Changes of the preset"
    format: Annotated[
        Literal["ola", "hdf5", "laz"], typer.Option(help="File format of the scans.")
    ] = "ola"
    images: Annotated[
        bool | None,
        typer.Option(
            "--images/--no-images", help="Whether images are rendered; by default as in the preset."
        ),
    ] = None
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Change a setting of the preset, by its name under 'settings' in truth.json: "
            "solution.noise=0.2, lidar.spacing=0.07, body.smallest_rock=0.05, "
            "campaign.legs.0.images=4. Repeat it for several.",
        ),
    ] = None
    base: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Shape (ICQ, OBJ or PLY) on which the body of a blind mission is built; distances "
            "and the mesh follow its size.",
        ),
    ] = None
    base_unit: Annotated[
        Literal["km", "m"], typer.Option(help="Unit of that shape, if it is OBJ or PLY.")
    ] = "km"


def make(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A new folder, or that of an unfinished mission.")
    ],
    preset: Annotated[
        Literal[
            "tiny", "mini", "pole", "demo", "bennu", "mission", "blind-small", "blind", "blind-full"
        ],
        typer.Option(
            help="tiny: for tests. mini: 75 m, 20 scans, 64 maplets, images. pole: mini with a "
            "pole that is never lit. demo: 60 m, a pole that is never lit, gaps between the scans. "
            "bennu: 245 m, 40 scans, images and maplets of the whole body. mission: 640 scans, "
            "lidar only unless --images is given. blind-small, blind, blind-full: raw images, "
            "nominal kernels, a coarse shape and scans of a body that overhangs, without an SPC "
            "solution; 78, 417 and 5,069 images. blind takes about 20 minutes on two cores, 4.8 GB "
            "of memory and 8.3 GB on the disk."
        ),
    ] = "mini",
    seed: Annotated[
        int,
        typer.Option(metavar="N", min=0, max=2**32 - 1, help="Seed of all random errors."),
    ] = 1,
    mission: MissionOptions = MissionOptions(),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only print its size.")] = False,
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Make a synthetic mission: lidar scans, images and an SPC solution of a known body.

    Its size is printed first, and it is refused if the disk lacks room. An interrupted run resumes
    if the command is given again. The planted values are written last, to truth.json.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.runtime import Progress, ThreadExecutor
    from fusion.truth import PRESETS, changed, make_mission, mission_size, on_base

    start = replace(PRESETS[preset](seed), lidar_format=mission.format)
    settings = on_base(start, mission.base, mission.base_unit)
    if mission.images is not None:
        settings = settings.with_images(mission.images)
    settings = changed(settings, mission.changes or [])
    size = mission_size(settings)
    progress = Progress.fitting(silent=as_json)
    content: dict[str, Any] = {
        "folder": str(folder),
        "preset": preset,
        "seed": seed,
        "size": size.as_dict(),
    }
    if dry_run:
        show(content, size.lines(), as_json=as_json)
        return
    for line in size.lines():
        progress.note(line)
    planted = make_mission(
        folder, settings=settings, executor=ThreadExecutor(workers), progress=progress
    )
    content["planted"] = planted.in_view()
    given = f"--spc {folder / 'spc'}"
    if planted.blind:
        given = f"--shape {folder / 'shape' / 'rough.obj'}"
    lines = [
        f"Made {folder}: {preset}, seed {seed}. Planted values are in {folder / 'truth.json'}.",
        f"Next: spcola init WS {given}, spcola import WS {folder / 'lidar'}/*",
    ]
    show(content, lines, as_json=as_json)


def assess(
    workspace: WorkspaceArgument,
    given: AssessOptions,
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare models with the truth of a synthetic mission.

    Prints 3D rms and optimised 3D rms, height errors by region, slopes, resolution, calibration of
    the stated sigmas, FormU, and recovered against planted parameters.
    """
    given.check()
    site = site_of(workspace, workers=workers, as_json=as_json)
    show(*assess_models(site, given), as_json=as_json)


app.command(
    "make",
    cls=PanelCommand,
    epilog="Example: spcola truth make /tmp/bennu --preset bennu --seed 2",
)(guarded(with_shared_options(make)))
app.command(
    "assess", epilog="Example: spcola truth assess WS --truth /tmp/bennu --report truth.html"
)(guarded(with_shared_options(assess)))
