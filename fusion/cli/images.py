"""``spcola images``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusion.cli.options import (
    JsonOption,
    SolutionOption,
    WorkersOption,
    WorkspaceArgument,
    each_between,
    executor_of,
)
from fusion.cli.output import MANY_LINES, show
from fusion.cli.states import BodyOptions, PoseOptions, StateOptions

if TYPE_CHECKING:
    from fusion.stages.images import ImportOptions, Recipe, StateChoice, TriageReport
    from fusion.stages.images.importing import Imported
    from fusion.stages.images.triage_report import Triage
    from fusion.workspace import Workspace

_Orientation = Literal[
    "as-stored", "mirrored-samples", "mirrored-lines", "half-turn", "transposed",
    "quarter-turn-right", "quarter-turn-left", "anti-transposed",
]  # fmt: skip


@dataclass(frozen=True)
class PixelOptions:
    """Options of what is done to pixels."""

    dark: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Dark frame, subtracted from each image.")
    ] = None
    dark_scale: Annotated[
        float,
        typer.Option(min=1e-6, max=1e6, help="Exposure time of the images over the dark frame's."),
    ] = 1.0
    flat: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Flat field; each image is divided by it.")
    ] = None
    bits: Annotated[
        int | None,
        typer.Option(metavar="8|16", min=8, max=16,
                     help="Bits of a pixel in the .DAT files; by default those of "
                     "the file, 16 for more than 8."),
    ] = None  # fmt: skip
    orientation: Annotated[
        _Orientation,
        typer.Option(help="How the pixels of the files are turned or mirrored before they are "
                     "written; --report finds it where there are states and a shape."),
    ] = "as-stored"  # fmt: skip
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(metavar="SAMPLES LINES", callback=each_between(1, 200_000),
                     help="Size of .DAT files: they have no header."),
    ] = None  # fmt: skip

    def recipe(self) -> Recipe:
        """Return what is done to the pixels."""
        from fusion.stages.images import Recipe, Turn

        if self.bits not in (None, 8, 16):
            raise typer.BadParameter("is 8 or 16", param_hint="--bits")
        bits: Any = self.bits
        return Recipe(self.dark, self.flat, self.dark_scale, bits, Turn(self.orientation))


@dataclass(frozen=True)
class ImageStateOptions:
    """Options that choose states and cameras."""

    states: Annotated[
        Literal["spice", "label", "isd", "colmap"] | None,
        typer.Option(
            help="Source of the states if it is no table (--poses): SPICE kernels at the labels' "
            "times, tables in the labels of ISIS cubes, ISD files named as the images, or a COLMAP "
            "model. Without a source only pixels come in."
        ),
    ] = None
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The camera: a camera file (spcola camera convert), or a .SUM file, whose "
            "thresholds are used too. ISD and COLMAP have cameras of their own.",
        ),
    ] = None
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder of the COLMAP model, or of the ISD files if they are not "
            "next to the images.",
        ),
    ] = None  # fmt: skip
    model_unit: Annotated[Literal["km", "m"], typer.Option(help="Unit of the COLMAP model.")] = "km"
    first_pixel: Annotated[
        float,
        typer.Option(min=0.0, max=1.0, help="COLMAP: coordinate of the first pixel's centre."),
    ] = 0.5
    times: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Times and directions to the Sun where states have none (CSV): image, utc, and "
            "sunx ... or subsolar_lat_deg, subsolar_lon_deg.",
        ),
    ] = None

    def choice(self, poses: PoseOptions, kernels: StateOptions, body: BodyOptions) -> StateChoice:
        """Return the source of states."""
        from fusion.stages.images import StateChoice, StateKind

        if poses.poses is not None and self.states is not None:
            raise typer.BadParameter("give --poses or --states, not both", param_hint="--states")
        if self.states == "colmap" and self.model is None:
            raise typer.BadParameter("is needed with --states colmap", param_hint="--model")
        if self.states == "spice" and not kernels.frame:
            raise typer.BadParameter("is needed with --states spice", param_hint="--frame")
        kind = StateKind.POSES if poses.poses is not None else StateKind(self.states or "")
        chosen = StateChoice(
            kind, poses.poses or self.model, self.camera, self.times,
            unit=self.model_unit, first_pixel=self.first_pixel,
        )  # fmt: skip
        if kind is StateKind.POSES:
            return replace(chosen, columns=poses.renamed(), pck=poses.pck,
                           kernels=kernels.source(body))  # fmt: skip
        if kind is StateKind.SPICE:
            return replace(chosen, kernels=kernels.source(body), frame=kernels.spice_camera())
        return chosen


def images(
    workspace: WorkspaceArgument,
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILE...",
            help="Images: FITS, PDS3, PDS4, ISIS cubes, TIFF, PNG, SPC's .DAT (with --size).",
        ),
    ] = None,
    letter: Annotated[
        str,
        typer.Option(
            metavar="C",
            help="Name the images by SPC's rule: this character, the time, the filter. By default "
            "the file's name, where it has up to 12 characters.",
        ),
    ] = "",
    filter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only images of this filter; repeat it for several."),
    ] = None,
    states: ImageStateOptions = ImageStateOptions(),
    table_of_poses: PoseOptions = PoseOptions(),
    kernels: StateOptions = StateOptions(),
    names: BodyOptions = BodyOptions(),
    pixels: PixelOptions = PixelOptions(),
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Look at all images of the workspace: what they show, range, resolution, phase, "
            "emission, and whether they fit the shape at their states, in which orientation and "
            "with which offset. Writes images.html.",
        ),
    ] = False,
    thumbnails: Annotated[
        bool, typer.Option("--thumbnails", help="With --report: small pictures on the page.")
    ] = False,
    workers: WorkersOption = None,
    solution: SolutionOption = "",
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait while another spcola brings images in.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Bring images into the workspace: pixels, and states where a source is named.

    Pixels are written to IMAGEFILES, states to SUMFILES and NOMINALS of the solution, and
    images.jsonl keeps each image's original name, file, digest, label, and where its state and
    camera come from. Nothing that is there is replaced; an image that is there already is
    recognised by its content. An interrupted import goes on where it was.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.workspace import Workspace

    if not files and not report:
        raise typer.BadParameter("give image files, or --report", param_hint="FILE")
    there = Workspace.open(workspace, solution)
    content: dict[str, Any] = {"workspace": there.root, "solution": there.solution}
    lines: list[str] = []
    if files:
        from fusion.stages.images import ImportOptions

        choice = states.choice(table_of_poses, kernels, names)
        options = ImportOptions(pixels.recipe(), choice, letter, tuple(filter or ()), pixels.size)
        lines += _bring_in(there, files, options, content, (workers, wait, as_json))
    if report:
        lines += _look_at(there, content, thumbnails=thumbnails, workers=workers, silent=as_json)
    show(content, lines, as_json=as_json)


def _bring_in(
    workspace: Workspace,
    files: list[Path],
    options: ImportOptions,
    content: dict[str, Any],
    how: tuple[int | None, bool, bool],
) -> Iterator[str]:
    """Import images; fill `content`, yield lines."""
    from fusion.runtime import Progress
    from fusion.stages.images import import_images

    workers, wait, silent = how
    done = import_images(
        workspace,
        files,
        options,
        executor=executor_of(workers, ""),
        progress=Progress.fitting(silent=silent),
        wait=wait,
    )
    content |= {
        "new": [record.as_json() for record in done.new],
        "known": [record.name for record in done.known],
        "filtered": done.filtered,
        "remarks": list(done.remarks),
    }
    yield from _import_lines(workspace, done)


def _look_at(
    workspace: Workspace,
    content: dict[str, Any],
    *,
    thumbnails: bool,
    workers: int | None,
    silent: bool,
) -> Iterator[str]:
    """Triage all images; write the page, fill `content`, yield lines."""
    import spcola
    from fusion.report.images import image_page, thumbnail
    from fusion.runtime import Progress
    from fusion.stages.images import triage_images
    from spcola import atomic
    from spcola.formats.images import read_image_data

    found = triage_images(
        workspace, executor=executor_of(workers, ""), progress=Progress.fitting(silent=silent)
    )
    remarks = [f"{one.name} ({one.original}) {one.remark}" for one in found.images if one.flags]
    pictures = {}
    if thumbnails:
        pictures = {
            one.name: thumbnail(read_image_data(workspace.exposure_path(one.name), *one.size))
            for one in found.images
        }
    page = workspace.home / "images.html"
    report = found.as_json()
    body = workspace.settings().body.name
    versions = {"spcola": spcola.__version__}
    atomic.write_text(page, image_page(body, report, remarks, pictures, versions))
    content |= {**report, "page": page, "doubtful": remarks}
    yield from _report_lines(found, remarks, page)


def _report_lines(found: TriageReport, remarks: list[str], page: Path) -> Iterator[str]:
    """Yield the table of the images, short where there are many, and what is doubtful."""
    rows = [
        f"  {one.name:12s} {one.scene:8s} {one.range_m:12.1f} m {one.resolution_m:9.4g} m/px "
        f"phase {one.phase_deg:6.1f} em {one.emission_deg:5.1f}{_fit_words(one)}"
        for one in found.images
    ]
    yield from _some(rows)
    counted = ", ".join(f"{number} {what}" for what, number in found.counts.items() if number)
    yield f"{len(found.images)} images: {counted}"
    if found.found_orientation:
        turns = ", ".join(f"{number} {turn}" for turn, number in found.found_orientation.items())
        right, down = found.offset_rms_px
        yield f"They fit the shape: {turns}; offsets {right:.1f} pixels, {down:.1f} lines rms"
    yield from _some([f"  {remark}" for remark in remarks])
    yield f"Page: {page}"


def _fit_words(one: Triage) -> str:
    """Return orientation, correlation and offset of an image."""
    if one.fit is None:
        return ""
    right, down = one.fit.offset_px
    where = one.fit.turn or "no clear orientation"
    return f"  {where} {one.fit.correlation:.2f}, {right:+.1f} {down:+.1f} px"


def _import_lines(workspace: Workspace, done: Imported) -> Iterator[str]:
    """Yield what came in."""
    stated = sum(record.state is not None for record in done.new)
    yield (
        f"{workspace.root}: {len(done.new)} new images, {stated} with a state "
        f"(solution {workspace.solution}); {len(done.known)} were there already"
    )
    if done.filtered:
        yield f"  {done.filtered} of other filters were left out"
    fits = [record.camera_fit for record in done.new if record.camera_fit is not None]
    for fit in {str(one): one for one in fits}.values():
        where = f"; the exact camera is SUMFILES/{fit['file']}" if fit["file"] else ""
        yield (
            f"  {fits.count(fit)} images: in .SUM files their {fit['model']} distortion is Owen's, "
            f"fitted to {fit['rms_px']:.2g} px rms, {fit['largest_px']:.2g} px at most{where}"
        )
    yield from _some([f"  {remark}" for remark in done.remarks])
    notes = [f"  {record.name}: {note}" for record in done.new for note in record.notes]
    yield from _some(notes)


def _some(lines: list[str]) -> Iterator[str]:
    """Yield lines, and of many the first ones and how many more there are."""
    yield from lines[:MANY_LINES]
    if len(lines) > MANY_LINES:
        yield f"  … and {len(lines) - MANY_LINES} more, all with --json"
