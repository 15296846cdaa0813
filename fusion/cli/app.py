"""``spcola``: the commands and the program's entry."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any

import typer

import spcola
from fusion.cli import (
    align,
    altimetry,
    camera,
    demo,
    folder,
    images,
    jobs,
    look,
    photometry,
    serve,
    solution,
    spc,
    stages,
    states,
    truth,
)
from fusion.cli.options import PanelCommand, with_shared_options
from fusion.cli.program import choose_server, guarded

app = typer.Typer(
    name="spcola",
    help="Fuses laser altimetry with stereophotoclinometry.",
    epilog="First run: spcola demo. With your own data: spcola init, import, run.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

COMMANDS: tuple[tuple[str, Callable[..., Any], str], ...] = (
    ("init", folder.init, "spcola init bennu --spc /data/spc --body Bennu"),
    ("import", altimetry.import_, "spcola import bennu ola/*.dat"),
    ("mapolas", stages.mapolas, "spcola mapolas bennu --gsd 0.2"),
    ("register", stages.register, "spcola register bennu --model rigid"),
    ("fuse", stages.fuse, "spcola fuse bennu"),
    ("bigmap", stages.bigmap, "spcola bigmap bennu"),
    ("scale", stages.scale, "spcola scale ryugu --method shots; spcola scale bennu --apply"),
    ("release", stages.release, "spcola release bennu"),
    ("report", stages.report, "spcola report bennu --solution images"),
    ("run", stages.run, "spcola run bennu --workers 4"),
    ("info", folder.info, "spcola info bennu; spcola info bennu/MAPFILES/AB0001.MAP --json"),
    ("look", look.look, "spcola look bennu; spcola look bennu/MAPFILES/AB0001.MAP -o map.png"),
    ("align", align.align, "spcola align scan.las site.ply -o moved.las"),
    (
        "images",
        images.images,
        "spcola images 67p navcam/*.png --poses poses.csv --camera navcam.toml --letter N",
    ),
    (
        "sumfiles",
        states.sumfiles,
        "spcola sumfiles bennu images.csv --frame ORX_OCAMS_MAPCAM --camera map.toml",
    ),
    ("kernels", states.kernels, "spcola kernels bennu kernels --pck bennu.tpc"),
    (
        "download",
        jobs.download,
        "spcola download bennu; spcola --server http://localhost:8080 download bennu",
    ),
    ("demo", demo.demo, "spcola demo /tmp/demo"),
)

for _name, _function, _example in COMMANDS:
    app.command(_name, cls=PanelCommand, epilog=f"Example: {_example}")(
        guarded(with_shared_options(_function))
    )
app.add_typer(solution.app)
app.add_typer(truth.app)
app.add_typer(camera.app)
app.add_typer(photometry.app)
app.add_typer(spc.app)
app.add_typer(serve.app)
app.add_typer(jobs.app)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"spcola {spcola.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[  # noqa: ARG001  typer calls its callback
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
    server: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help="Give the command to the server of spcola serve at this address; WS is then the "
            "name of a workspace there. The variable SPCOLA_TOKEN has the token, if one is needed.",
        ),
    ] = "",
) -> None:
    """Fuses laser altimetry with stereophotoclinometry."""
    choose_server(server)


def main() -> None:
    """Run the command line."""
    try:
        app()
    except SystemExit as end:
        if not end.code:
            raise
        # HDF5 crashes in its clean-up if a file could not be flushed (a full disk). The error has
        # been printed by now: the process ends without that clean-up.
        with suppress(OSError):
            sys.stdout.flush()
        with suppress(OSError):
            sys.stderr.flush()
        os._exit(end.code if isinstance(end.code, int) else 1)
