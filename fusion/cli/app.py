"""``spcola``: the commands and the program's entry."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any

import typer

import spcola
from fusion.cli.options import PanelCommand, with_shared_options
from fusion.cli.program import choose_server, guarded

COMMANDS: tuple[tuple[str, str, str], ...] = (
    ("init", "folder.init", "spcola init bennu --spc /data/spc --body Bennu"),
    ("import", "altimetry.import_", "spcola import bennu ola/*.dat"),
    ("mapolas", "stages.mapolas", "spcola mapolas bennu --gsd 0.2"),
    ("register", "stages.register", "spcola register bennu --model rigid"),
    ("fuse", "stages.fuse", "spcola fuse bennu"),
    ("bigmap", "stages.bigmap", "spcola bigmap bennu"),
    ("scale", "stages.scale", "spcola scale ryugu --method shots; spcola scale bennu --apply"),
    ("release", "stages.release", "spcola release bennu"),
    ("report", "stages.report", "spcola report bennu --solution images"),
    ("run", "stages.run", "spcola run bennu --workers 4"),
    ("info", "folder.info", "spcola info bennu; spcola info bennu/MAPFILES/AB0001.MAP --json"),
    ("look", "look.look", "spcola look bennu; spcola look bennu/MAPFILES/AB0001.MAP -o map.png"),
    ("align", "align.align", "spcola align scan.las site.ply -o moved.las"),
    (
        "images",
        "images.images",
        "spcola images 67p navcam/*.png --poses poses.csv --camera navcam.toml --letter N",
    ),
    (
        "sumfiles",
        "states.sumfiles",
        "spcola sumfiles bennu images.csv --frame ORX_OCAMS_MAPCAM --camera map.toml",
    ),
    ("kernels", "states.kernels", "spcola kernels bennu kernels --pck bennu.tpc"),
    (
        "download",
        "jobs.download",
        "spcola download bennu; spcola --server http://localhost:8080 download bennu",
    ),
    ("demo", "demo.demo", "spcola demo /tmp/demo"),
)
"""Name of each command, its module and function in this package, and an example."""
_GROUPS = {
    "solution": "solution",
    "truth": "truth",
    "camera": "camera",
    "photometry": "photometry",
    "spc": "spc",
    "serve": "serve",
    "job": "jobs",
}


def command_line(wanted: str = "") -> typer.Typer:
    """Return the program, or the part of it with one command or group.

    Parameters
    ----------
    wanted : str
        Its name. The others are not imported then, which would take a quarter of a second. All are
        there with any other name, so that a wrong one is named with those that exist.
    """
    app = typer.Typer(
        name="spcola",
        help="Fuses laser altimetry with stereophotoclinometry.",
        epilog="First run: spcola demo. With your own data: spcola init, import, run.",
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    one = wanted in _GROUPS or any(name == wanted for name, _, _ in COMMANDS)
    for name, place, example in COMMANDS:
        if not one or name == wanted:
            command = with_shared_options(_found(place))
            app.command(name, cls=PanelCommand, epilog=f"Example: {example}")(guarded(command))
    for name, module in _GROUPS.items():
        if not one or name == wanted:
            app.add_typer(_found(f"{module}.app"))
    return app


def _found(place: str) -> Any:
    """Return what a module of this package has under a name."""
    module, name = place.split(".")
    return getattr(import_module(f"fusion.cli.{module}"), name)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"spcola {spcola.__version__}")
        raise typer.Exit


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
        command_line(next(iter(sys.argv[1:]), ""))()
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
