"""Brightnesses of the maplets of a workspace in its images, for fits of photometric functions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from fusion.runtime import Executor, Progress
from fusion.scene import Exposures
from fusion.stages.images.catalogue import read_catalogue
from fusion.stages.images.record import ImageRecord
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError, NotObservableError
from spcola.imagematching import ChoiceOptions, choose_images
from spcola.photometry import ortho_rectify, view_of
from spcola.photometry.fitting import BlockSamples, SampleOptions, sample_blocks
from spcola.shape import RayCaster

# Fewest blocks of an image: its scale takes one of them.
_FEWEST = 6
# Most cells of a filter: a fit of the rough Hapke function takes half a minute with them.
_MOST_CELLS = 300_000
# The filter of images for which images.jsonl states none.
_UNKNOWN = "unknown"


@dataclass(frozen=True)
class PhotometryOptions:
    """What is fitted, to what.

    Parameters
    ----------
    functions : tuple of str
        As in settings; parameters that are given are fixed.
    filter : str
        Images of this filter alone; empty for all, each filter by itself.
    calibrated : bool
        Whether one scale λ is common to all images of a filter. The gains by which the import
        changed their numbers are undone.
    max_maplets, max_images : int
        Most maplets, evenly over the list, and images of one filter of a maplet.
    ground : SampleOptions
    """

    functions: tuple[str, ...]
    filter: str = ""
    calibrated: bool = False
    max_maplets: int = 60
    max_images: int = 20
    ground: SampleOptions = field(default_factory=SampleOptions)


@dataclass(frozen=True, eq=False)
class FilterSamples:
    """Blocks of the images of one filter: image, number of the maplet, samples."""

    filter: str
    found: list[tuple[str, int, BlockSamples]]

    @property
    def images(self) -> int:
        """The number of images."""
        return len({name for name, _, _ in self.found})


@dataclass(frozen=True, eq=False)
class _Work:
    """Samples the maplets of a workspace, one by one; `images` are those of each filter."""

    workspace: Workspace
    images: dict[str, list[SpcImage]]
    exposed: Exposures
    beyond: RayCaster | None
    gains: Mapping[str, float]
    options: PhotometryOptions

    def maplet(self, name: str) -> list[tuple[str, BlockSamples]]:
        """Return the samples of a maplet: name of an image and blocks."""
        maplet = self.workspace.maplet(name)
        choice = ChoiceOptions(most=self.options.max_images)
        found = []
        # Of each filter by itself: one with many images leaves no other without any.
        chosen = [choose_images(maplet.grid, one, options=choice) for one in self.images.values()]
        for image in chain.from_iterable(chosen):
            try:
                view = view_of(image, maplet.grid, maplet.height, beyond=self.beyond)
            except InvalidValueError:
                continue  # the grid reaches behind the camera
            ortho = ortho_rectify(self.exposed(image), view)
            blocks = sample_blocks(ortho, maplet.albedo, self.options.ground)
            if blocks is not None:
                found.append((image.name, blocks.scaled(1.0 / self.gains.get(image.name, 1.0))))
        return found


def sampled_filters(
    workspace: Workspace, options: PhotometryOptions, executor: Executor, progress: Progress
) -> list[FilterSamples]:
    """Return the samples of each filter of the images of a workspace.

    Raises
    ------
    NotObservableError
        If no image has pixels, is of the filter, or shows a maplet well; or the scale of some
        calibrated ones is unknown.
    """
    records = read_catalogue(workspace)
    filters = _filters(workspace, records, options.filter)
    gains = _gains(records, filters) if options.calibrated else {}
    images = {kind: list[SpcImage]() for kind in sorted(set(filters.values()))}
    for state in workspace.images():
        if state.name in filters:
            images[filters[state.name]].append(state)
    names = workspace.maplet_names()
    names = names[:: max(-(-len(names) // options.max_maplets), 1)]
    shape = RayCaster(workspace.shape()) if workspace.has_shape() else None
    work = _Work(workspace, images, Exposures(workspace), shape, gains, options)
    found: list[tuple[str, int, BlockSamples]] = []
    with progress.task("sample maplets in images", len(names)) as task:
        for number, each in enumerate(executor.stream(work.maplet, names)):
            found += [(image, number, blocks) for image, blocks in each]
            task.advance()
    blocks_of: Counter[str] = Counter()
    for image, _, blocks in found:
        blocks_of[image] += blocks.brightness.size
    found = [one for one in found if blocks_of[one[0]] >= _FEWEST]
    if not found:
        raise NotObservableError(
            "no image shows a maplet well seen and well lit",
            where=workspace.root,
            do="see the images and maplets: spcola look",
        )
    kinds = sorted({filters[image] for image, _, _ in found})
    return [_limited(kind, [one for one in found if filters[one[0]] == kind]) for kind in kinds]


def _limited(kind: str, found: list[tuple[str, int, BlockSamples]]) -> FilterSamples:
    """Return the samples of a filter, thinned evenly where there are very many."""
    step = -(-sum(one.phase.size for _, _, one in found) // _MOST_CELLS)
    return FilterSamples(kind, [(image, ground, one.thinned(step)) for image, ground, one in found])


def _filters(
    workspace: Workspace, records: Mapping[str, ImageRecord], wanted: str
) -> Mapping[str, str]:
    """Return the filter of each image with pixels, or of those of one filter.

    Raises
    ------
    NotObservableError
        If there are none.
    """
    named = {
        name: str((records[name].label if name in records else {}).get("filter") or _UNKNOWN)
        for name in workspace.image_names()
        if workspace.exposure_path(name).is_file()
    }
    if not named:
        raise NotObservableError(
            "no image has pixels",
            where=workspace.root / "IMAGEFILES",
            do="bring some: spcola images",
        )
    chosen = {name: kind for name, kind in named.items() if not wanted or kind == wanted}
    if not chosen:
        known = ", ".join(sorted(set(named.values())))
        raise NotObservableError(
            f"no image is of the filter {wanted!r}", where="--filter", do=f"known are {known}"
        )
    return chosen


def _gains(records: Mapping[str, ImageRecord], images: Iterable[str]) -> dict[str, float]:
    """Return the numbers in a pixels' file for 1 in the original of each image.

    An import scales each floating-point image to 16 bits by itself: one scale for all is there
    only before. Images of other programs have none, and count as they are.

    Raises
    ------
    NotObservableError
        If some images were scaled, and of others it is unknown whether.
    """
    gains = {name: records[name].pixels.gain for name in images if name in records}
    unknown = sorted(set(images) - set(gains))
    if unknown and any(gain != 1.0 for gain in gains.values()):
        raise NotObservableError(
            f"images.jsonl states the gain of {len(gains)} images, but not of {unknown[0]}"
            + (f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""),
            where="--calibrated",
            do="import all of them with spcola images, or leave --calibrated out",
        )
    return gains


def ranges(found: FilterSamples) -> dict[str, list[float]]:
    """Return the least and the largest phase, incidence and emission angle, degrees."""
    phase = np.concatenate([one.phase.ravel() for _, _, one in found.found])
    cosines = np.concatenate([one.cosines.reshape(2, -1) for _, _, one in found.found], axis=1)
    angles = {
        "phase_deg": np.degrees(phase),
        "incidence_deg": np.degrees(np.arccos(cosines[0])),
        "emission_deg": np.degrees(np.arccos(cosines[1])),
    }
    return {key: [float(one.min()), float(one.max())] for key, one in angles.items()}
