"""What ``spcola spc register`` does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from fusion.service.commands.site import Done, Site

__all__ = ["RegisterCommandOptions", "register_images"]


@dataclass(frozen=True)
class RegisterCommandOptions:
    """Options of ``spcola spc register``."""

    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="This image; repeat it for several. Else all."),
    ] = None
    position_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            min=1e-6,
            max=1e9,
            help="Sigma of each coordinate of the positions before. By default what the .SUM files "
            "state, else a hundredth of the distance.",
        ),
    ] = None
    photometry: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Photometric function with its parameters; by default that of [lithos], else of "
            "[register].",
        ),
    ] = ""
    name: Annotated[
        str,
        typer.Option(
            "--as", metavar="NAME", help="Name of the new solution, else registered-1, ..."
        ),
    ] = ""


def register_images(site: Site, given: RegisterCommandOptions) -> Done:
    """Make a solution with states of images that fit the shape."""
    from fusion.pipeline import find_table
    from fusion.stages.spc_register import RegisterOptions, register_states
    from fusion.workspace.settings.processing import LithosSettings, RegisterSettings
    from spcola.imagematching.frames.fitting import FrameFitOptions
    from spcola.photometry.functions import photometric_function

    workspace = site.open()
    settings = workspace.settings()
    usual = find_table(settings, LithosSettings).photometry
    usual = usual or find_table(settings, RegisterSettings).photometry
    function = photometric_function(given.photometry or usual)
    options = RegisterOptions(
        tuple(given.only or ()), FrameFitOptions(function, given.position_sigma)
    )
    result = register_states(
        workspace, given.name, options, site.executor, site.progress, job=site.job
    )
    return Done({"workspace": workspace.root, **result.as_dict()}, result.lines())
