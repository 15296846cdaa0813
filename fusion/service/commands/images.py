"""``spcola images``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusion.service.commands.image_options import (
    ImageStateOptions,
    NameOptions,
    PixelOptions,
    ReportOptions,
)
from fusion.service.commands.site import Done, Site
from fusion.service.commands.states import check_kernels

if TYPE_CHECKING:
    from fusion.stages.images.importing import Imported
    from fusion.stages.images.triage_report import Triage, TriageReport
    from fusion.workspace import Workspace

__all__ = ["ImagesOptions", "bring_images", "companions_of"]
MANY_LINES = 25
"""A longer list is not printed as text, only counted."""
_RANGE_TO = {True: "surface", False: "center"}


@dataclass(frozen=True)
class ImagesOptions:
    """Options of ``spcola images``."""

    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILE...",
            help="Images: FITS, PDS3, PDS4, ISIS cubes, TIFF, PNG, SPC's .DAT (with --size).",
        ),
    ] = None
    names: NameOptions = NameOptions()
    states: ImageStateOptions = ImageStateOptions()
    pixels: PixelOptions = PixelOptions()
    looks: ReportOptions = ReportOptions()

    def check(self) -> None:
        """Refuse options that contradict each other.

        Raises
        ------
        typer.BadParameter
        """
        if not self.files and not self.looks.report:
            raise typer.BadParameter("give image files, or --report", param_hint="FILE")
        self.states.choice()
        self.pixels.check()


def bring_images(site: Site, given: ImagesOptions) -> Done:
    """Bring images into a workspace, and look at all of them if that is asked for."""
    given.check()
    there = site.open()
    content: dict[str, Any] = {"workspace": there.root, "solution": there.solution}
    lines: list[str] = []
    if given.files:
        lines += _bring_in(there, given, site, content)
    if given.looks.report:
        lines += _look_at(there, content, site, thumbnails=given.looks.thumbnails)
    return Done(content, lines)


def companions_of(paths: Iterable[Path], *, isd: bool = False) -> list[Path]:
    """Return the files that images need and that are not among them: labels, pixels, ISD files.

    Parameters
    ----------
    paths : iterable of Path
        Images, and files of other kinds: these need none.
    isd : bool
        Whether states are those of ISD files next to the images.

    Raises
    ------
    SpcolaError
        If one cannot be read.
    """
    from fusion.stages.images import isd_file
    from spcola.formats.images.open_image import files_of_image

    given = list(paths)
    found: dict[Path, None] = {}
    for path in given:
        found |= dict.fromkeys(files_of_image(path))
        if isd and (file := isd_file(path)) is not None:
            found[file] = None
    return [path for path in found if path not in given]


def _bring_in(
    workspace: Workspace, given: ImagesOptions, site: Site, content: dict[str, Any]
) -> Iterator[str]:
    """Import images; fill `content`, yield lines."""
    from fusion.stages.images import ImportOptions, import_images

    choice = given.states.choice()
    check_kernels(site, choice.kernels.kernels)
    options = ImportOptions(
        given.pixels.recipe(given.states.camera),
        choice,
        given.names.letter,
        tuple(given.names.filter or ()),
        given.pixels.size,
    )
    done = import_images(
        workspace,
        given.files or [],
        options,
        executor=site.executor,
        progress=site.progress,
        wait=site.wait,
        lasting=site.lasting,
    )
    content |= {
        "new": [record.as_json() for record in done.new],
        "known": [record.name for record in done.known],
        "filtered": done.filtered,
        "smear": None if options.recipe.smear is None else asdict(options.recipe.smear),
        "remarks": list(done.remarks),
        "doubts": [one.as_json() for one in done.doubts],
    }
    yield from _import_lines(workspace, done)
    if (smear := options.recipe.smear) is not None:
        yield (
            f"  Smear of the frame transfer was removed: {smear.line_transfer_s:.4g} s a line, "
            f"memory at the {smear.memory_side} (--smear-s 0 leaves it)"
        )


def _look_at(
    workspace: Workspace, content: dict[str, Any], site: Site, *, thumbnails: bool
) -> Iterator[str]:
    """Triage all images; write the page, fill `content`, yield lines."""
    import spcola
    from fusion.report.images import image_page, thumbnail
    from fusion.stages.images import triage_images
    from spcola import atomic
    from spcola.formats.images import read_image_data

    found = triage_images(workspace, executor=site.executor, progress=site.progress)
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
    shape = workspace.has_shape()
    content |= {**report, "page": page, "doubtful": remarks, "range_to": _RANGE_TO[shape]}
    if not shape:
        yield (
            "There is no shape in SHAPEFILES: range, size of a pixel and phase are those at the "
            "body's centre"
        )
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
    yield f"{_images(len(found.images))}: {counted}"
    if found.found_orientation:
        turns = ", ".join(f"{number} {turn}" for turn, number in found.found_orientation.items())
        right, down = found.offset_rms_px
        yield f"They fit the shape: {turns}; offsets {right:.1f} pixels, {down:.1f} lines rms"
    for code, number in found.likely.items():
        yield f"Likely wrong in the states of {number} of them [{code}]: see below"
    yield from _some([f"  {remark}" for remark in remarks])
    yield f"Page: {page}"


def _fit_words(one: Triage) -> str:
    """Return orientation, correlation and offset of an image."""
    from fusion.stages.images.triage_report import correlation_text

    if one.fit is None:
        return ""
    right, down = one.fit.offset_px
    where = one.fit.turn or "no clear orientation"
    return f"  {where} {correlation_text(one.fit.correlation)}, {right:+.1f} {down:+.1f} px"


def _import_lines(workspace: Workspace, done: Imported) -> Iterator[str]:
    """Yield what came in."""
    stated = sum(record.state is not None for record in done.new)
    yield (
        f"{workspace.root}: {_images(len(done.new), 'new ')}, {stated} with a state "
        f"(solution {workspace.solution}); {len(done.known)} were there already"
    )
    if done.filtered:
        yield f"  {done.filtered} of other filters were left out"
    yield from (f"  {one.line}" for one in done.doubts)
    fits = [record.camera_fit for record in done.new if record.camera_fit is not None]
    for fit in {str(one): one for one in fits}.values():
        where = f"; the exact camera is SUMFILES/{fit['file']}" if fit["file"] else ""
        yield (
            f"  {_images(fits.count(fit))}: in .SUM files Owen's distortion replaces "
            f"{fit['model']}, fitted to {fit['rms_px']:.2g} px rms, {fit['largest_px']:.2g} px at "
            f"most{where}"
        )
    yield from _some([f"  {remark}" for remark in done.remarks])
    notes = [f"  {record.name}: {note}" for record in done.new for note in record.notes]
    yield from _some(notes)


def _images(count: int, kind: str = "") -> str:
    return f"{count} {kind}image{'' if count == 1 else 's'}"


def _some(lines: list[str]) -> Iterator[str]:
    """Yield lines, and of many the first ones and how many more there are."""
    yield from lines[:MANY_LINES]
    if len(lines) > MANY_LINES:
        yield f"  … and {len(lines) - MANY_LINES} more, all with --json"
