"""``spcola sumfiles`` and ``spcola kernels``."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusion.service.commands.fields import Mark
from fusion.service.commands.site import Done, Site
from fusion.service.commands.state_options import BodyOptions, GivenStates, NewSumOptions

if TYPE_CHECKING:
    from spcola.navigation.states import ImageState, StateDifference
    from spcola.spice.state_kernels import StateKernels


__all__ = ["KernelsOptions", "SumfilesOptions", "check_kernels", "make_kernels", "make_states"]


@dataclass(frozen=True)
class SumfilesOptions:
    """Options of ``spcola sumfiles``."""

    table: Annotated[
        Path | None,
        typer.Argument(
            metavar="TABLE",
            help="Names and times of the images (CSV): columns image and utc, et or clock; with "
            "exposure_s or exposure_ms the time is the start, without the middle.",
        ),
    ] = None
    image: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Take name and time from the label of this image instead; repeat it.",
        ),
    ] = None
    compare: Annotated[
        bool,
        typer.Option(
            "--compare", help="Write nothing: compare the kernels with the states in SUMFILES."
        ),
    ] = False
    made_with: NewSumOptions = NewSumOptions()
    sources: GivenStates = GivenStates()

    def check(self) -> None:
        """Refuse options that contradict each other.

        Raises
        ------
        typer.BadParameter
        """
        poses = self.sources.table.poses
        given = sum(source is not None for source in (self.table, self.image, poses))
        if given > 1 or (not self.compare and (given == 0 or self.made_with.camera is None)):
            raise typer.BadParameter(
                "give TABLE, --image or --poses, and --camera; or --compare", param_hint="TABLE"
            )
        if poses is None and not self.sources.kernels.frame:
            raise typer.BadParameter("is needed with kernels", param_hint="--frame")
        self.sources.table.renamed()


@dataclass(frozen=True)
class KernelsOptions:
    """Options of ``spcola kernels``."""

    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="A new folder for the kernels."), Mark.OUTPUT
    ]
    pck: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="PCK with the rotation of the solution; else that of [spin] with its shifts, else "
            "that of [spice] kernels.",
        ),
    ] = None
    max_gap_s: Annotated[
        float,
        typer.Option(
            "--max-gap",
            metavar="S",
            min=2.0,
            max=1e7,
            help="Positions further apart, seconds, are not interpolated between.",
        ),
    ] = 600.0
    camera: Annotated[
        int,
        typer.Option(
            metavar="NUMBER",
            min=-(10**9),
            max=0,
            help="NAIF number of the first camera; if not given, the spacecraft's × 1000 − 990.",
        ),
    ] = 0
    names: BodyOptions = BodyOptions()


def make_states(site: Site, given: SumfilesOptions) -> Done:
    """Write .SUM and .NOM files, or compare the kernels with those that are there."""
    from fusion.stages.states import compare_with_solution, make_sumfiles
    from spcola.formats.solution.exact_camera import stored_camera
    from spcola.formats.states import exposure_of, read_exposures

    given.check()
    check_kernels(site, given.sources.kernels.kernel or ())
    there, made_with = site.open(), given.made_with
    exposures = None if given.table is None else read_exposures(given.table)
    exposures = [exposure_of(path) for path in given.image] if given.image else exposures
    found = given.sources.states(there, exposures)
    found = found.named(made_with.letter) if made_with.letter else found
    if given.compare:
        differences = compare_with_solution(there, found)
        compared = {"images": [one.as_json() for one in differences]}
        return Done(compared, _comparison_lines(differences))
    made = make_sumfiles(there, found, made_with.nominal(), wait=site.wait)
    originals = found.originals or [state.name for state in made]
    content = {
        "workspace": there.root,
        "images": [
            {**_state_facts(state), "original": original}
            for state, original in zip(made, originals, strict=True)
        ],
    }
    stored = stored_camera(there.image(made[0].name).camera)
    fitted = [f"  {stored.text}: {stored.file}"] if stored.file else []
    if stored.file:
        content["camera_fit"] = stored.as_json()
    ranges = [math.hypot(*state.scobj) for state in made]
    line = (
        f"Wrote {'.SUM' if found.body_rates is None else '.SUM and .NOM'} of {len(made)} images, "
        f"{min(ranges):.6g} to {max(ranges):.6g} m from the body's centre"
    )
    return Done(content, [line, *fitted])


def make_kernels(site: Site, given: KernelsOptions) -> Done:
    """Write SPICE kernels from the solved states of the images."""
    from fusion.stages.line_scans import line_scans_not_used
    from fusion.stages.states import SourceOptions, export_kernels

    there, out = site.open(), given.out
    made = export_kernels(
        there,
        there.settings(),
        out,
        options=SourceOptions(spacecraft=given.names.spacecraft, body=given.names.body),
        pck=given.pck,
        camera=given.camera,
        max_gap_s=given.max_gap_s,
    )
    left = line_scans_not_used(there)
    lines = [f"  {one['text']} [{one['code']}]" for one in left.values()]
    return Done({**_kernel_facts(out, made), **left}, [*_kernel_lines(out, made), *lines])


def check_kernels(site: Site, kernels: Iterable[Path]) -> None:
    """Refuse meta-kernels that name kernels outside the folders of the site.

    Raises
    ------
    InvalidValueError, KernelError
    """
    from spcola.spice import expand_meta_kernels

    for path in kernels if site.folders else ():
        site.check_inside(expand_meta_kernels([path]), path)


def _state_facts(state: ImageState) -> dict[str, Any]:
    """Return a state for ``--json``."""
    return {
        "image": state.name,
        "et": state.time,
        "source": state.source,
        "scobj_m": state.scobj.tolist(),
        "axes": state.axes.tolist(),
        "sun": state.sun.tolist(),
    }


def _comparison_lines(found: list[StateDifference]) -> list[str]:
    """Return the largest and the middle difference of all images."""
    import numpy as np

    def row(name: str, values: Any, unit: str) -> str:
        size = np.abs(np.array(values))
        known = size[np.isfinite(size).all(axis=1)]
        if not len(known):
            return f"  {name}: unknown"
        median, most = np.median(known, axis=0), known.max(axis=0)
        parts = [f"{a:.4g} ({b:.4g})" for a, b in zip(median, most, strict=True)]
        return f"  {name}, {unit}: {', '.join(parts)}"

    return [
        f"Differences from the solution, {len(found)} images: median (largest) of their sizes",
        row("along the track, across, radial", [one.track_m for one in found], "m"),
        row("along Cx, Cy, Cz", [one.camera_m for one in found], "m"),
        row("pointing about Cx, Cy, Cz", [np.degrees(one.pointing) for one in found], "°"),
        row("at the boresight, pixel and line", [one.pixels for one in found], "px"),
    ]


def _kernel_facts(out: Path, made: StateKernels) -> dict[str, Any]:
    return {
        "folder": out,
        "files": list(made.files),
        "images": made.images,
        "cameras": made.cameras,
        "segments": made.segments,
        "span_et": list(made.span),
        "read_back_position_m": made.position_m,
        "read_back_pointing_rad": made.pointing,
    }


def _kernel_lines(out: Path, made: StateKernels) -> list[str]:
    from spcola.navigation import utc_from_et

    first, last = (utc_from_et(time) for time in made.span)
    return [
        f"{out}: {', '.join(made.files)}",
        f"  images: {made.images}, cameras: {made.cameras}, {first} to {last} UTC, in "
        f"{made.segments} arcs",
        f"  read back: within {made.position_m:.2g} m and {made.pointing:.2g} rad",
    ]
