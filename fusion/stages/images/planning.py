"""Which images come in under which names, and whether they fit what is there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from fusion.stages.images.choice import StateChoice
from fusion.stages.images.opened import OpenedImage, names_of
from fusion.stages.images.pixels import Recipe
from fusion.stages.images.record import ImageRecord
from fusion.stages.images.sources import Sighting, stated_times
from fusion.stages.images.turns import Turn
from fusion.workspace import Workspace
from spcola.errors import InvalidValueError, WorkspaceError


@dataclass(frozen=True, eq=False)
class ImportOptions:
    """How images come in.

    Parameters
    ----------
    recipe : Recipe
    states : StateChoice
    letter : str
        First character of the names; see :func:`fusion.stages.images.opened.names_of`.
    filters : tuple of str
        Only images of these filters come in; all if empty.
    size : (2,) of int, optional
        Samples and lines of .DAT files.
    """

    recipe: Recipe = field(default_factory=Recipe)
    states: StateChoice = field(default_factory=StateChoice)
    letter: str = ""
    filters: tuple[str, ...] = ()
    size: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class Planned:
    """An image with its name and state."""

    name: str
    image: OpenedImage
    sighting: Sighting | None


def known_images(
    workspace: Workspace,
    images: Iterable[OpenedImage],
    catalogue: Mapping[str, ImageRecord],
    options: ImportOptions,
) -> dict[str, ImageRecord]:
    """Return the records of images that are in the catalogue with their pixels, by digest."""
    by_digest = {
        record.digest: record
        for record in catalogue.values()
        if workspace.exposure_path(record.name).is_file()
    }
    recipe = options.recipe.digest
    known = {}
    for image in images:
        record = by_digest.get(image.digest)
        if record is None:
            continue
        if record.recipe != recipe:
            raise WorkspaceError(
                f"is there already as {record.name}, prepared with other --dark, --flat, "
                "--smear-s, --bits, --gamma, thresholds or --orientation",
                image.path,
                f"remove IMAGEFILES/{record.name}.DAT and SUMFILES/{record.name}.SUM first",
            )
        if record.size != turned_size(image, options):
            raise WorkspaceError(
                f"is there already as {record.name}, read as {record.size[0]} × {record.size[1]} "
                f"pixels and not as {image.size[0]} × {image.size[1]}",
                image.path,
                f"correct --size or the label, or remove IMAGEFILES/{record.name}.DAT first",
            )
        known[image.digest] = record
    return known


def plan_images(
    workspace: Workspace,
    images: Sequence[OpenedImage],
    sightings: Mapping[str, Sighting],
    known: Mapping[str, ImageRecord],
    catalogue: Mapping[str, ImageRecord],
    options: ImportOptions,
) -> list[Planned]:
    """Return what is to be written, after checking names and sizes."""
    times = stated_times(images, options.states)
    times |= {digest: one.state.time for digest, one in sightings.items()}
    new = [image for image in images if image.digest not in known]
    names = {**names_of(new, times, options.letter), **{d: r.name for d, r in known.items()}}
    planned = []
    for image in images:
        name, sighting = names[image.digest], sightings.get(image.digest)
        one = Planned(name, image, sighting)
        if image.digest in known and (sighting is None or known[image.digest].state is not None):
            continue
        other = catalogue.get(name)
        if other is not None and other.digest != image.digest:
            raise InvalidValueError(
                f"gets the name {name}, which {other.source} has",
                image.path,
                "rename the file, or give another --letter",
            )
        _check_size(workspace, one, options)
        planned.append(one)
    return planned


def _check_size(workspace: Workspace, one: Planned, options: ImportOptions) -> None:
    """Refuse an image of another size than its camera."""
    width, height = turned_size(one.image, options)
    turn = options.recipe.turn
    if one.sighting is not None and one.sighting.scan is not None and turn is not Turn.AS_STORED:
        raise InvalidValueError(
            f"cannot be turned ({turn}): its lines were exposed one after the other",
            one.image.path,
            "leave --orientation out",
        )
    if one.sighting is not None:
        size, where = one.sighting.size, one.sighting.camera_origin
    elif workspace.image_path(one.name).is_file():
        size, where = workspace.image(one.name).size, str(workspace.image_path(one.name))
    elif workspace.line_scan_path(one.name).is_file():
        size, where = workspace.line_scan(one.name).size, str(workspace.line_scan_path(one.name))
    else:
        return
    if size != (width, height):
        raise InvalidValueError(
            f"has {width} × {height} pixels, its camera in {where} {size[0]} × {size[1]}",
            one.image.path,
            "give the camera of this image",
        )


def turned_size(image: OpenedImage, options: ImportOptions) -> tuple[int, int]:
    """Return samples and lines of the .DAT file."""
    width, height = image.size
    return (height, width) if options.recipe.turn.exchanges else (width, height)
