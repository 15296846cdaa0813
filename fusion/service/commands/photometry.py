"""What ``spcola photometry fit`` does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import typer

from fusion.service.commands.site import Done, Site

__all__ = ["FitOptions", "fit_functions"]

# Those that images with scales of their own distinguish; and those with phase functions, which
# images of one scale determine.
_USUAL = (
    "lambert",
    "lommel-seeliger",
    "lunar-lambert a=-0.019 b=2.42e-4 c=-1.46e-6",
    "lunar-lambert-exponential",
    "minnaert",
    "akimov",
    "akimov-phase slope=0",
    "hapke-rough B0=1 h=0.06",
)
_USUAL_CALIBRATED = (
    "lambert",
    "lommel-seeliger",
    "lommel-seeliger-exponential",
    "lunar-lambert",
    "lunar-lambert-exponential",
    "minnaert",
    "akimov-phase",
    "hapke-rough",
)


@dataclass(frozen=True)
class FitOptions:
    """Options of ``spcola photometry fit``."""

    function: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A photometric function; repeat it for several. A parameter that is given is "
            'kept: "minnaert k_slope=0". By default those that such data distinguish.',
        ),
    ] = None
    filter: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Images of this filter alone; by default each filter by itself."
        ),
    ] = ""
    calibrated: Annotated[
        bool,
        typer.Option(
            "--calibrated",
            help="The images are radiometrically calibrated: one scale for all of a filter, so "
            "that phase functions and, of I/F, the normal albedo are determined too.",
        ),
    ] = False
    max_maplets: Annotated[
        int, typer.Option(metavar="N", min=1, max=100_000, help="Most maplets, evenly chosen.")
    ] = 60
    max_images: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, max=10_000, help="Most images of a maplet, of each filter."
        ),
    ] = 20
    max_incidence: Annotated[
        float, typer.Option(metavar="DEG", min=1.0, max=89.0, help="Largest incidence angle.")
    ] = 75.0
    max_emission: Annotated[
        float, typer.Option(metavar="DEG", min=1.0, max=89.0, help="Largest emission angle.")
    ] = 75.0


def fit_functions(site: Site, given: FitOptions) -> Done:
    """Fit photometric functions to the images of a solution over its maplets."""
    from fusion.stages.photometry import PhotometryOptions, fit_photometry, photometry_lines
    from spcola.photometry.fitting import SampleOptions

    ground = SampleOptions(math.radians(given.max_incidence), math.radians(given.max_emission))
    usual = _USUAL_CALIBRATED if given.calibrated else _USUAL
    options = PhotometryOptions(
        tuple(given.function or usual),
        given.filter,
        given.calibrated,
        given.max_maplets,
        given.max_images,
        ground,
    )
    there = site.open()
    content = fit_photometry(there, options, site.executor, site.progress)
    return Done({"workspace": there.root, **content}, photometry_lines(content))
