"""A solution with states of images that fit the shape: ``spcola spc register``."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.pipeline.catalog import file_digest
from fusion.pipeline.items import ItemStore, item_folder, whole_version
from fusion.pipeline.solutions import MadeBy, making_solution, new_name, solutions_of
from fusion.runtime import Executor, Progress, json_text
from fusion.runtime.remaining import Timed
from fusion.stages.images.causes import COARSE, better_turn, is_distinct, match_frame, step_of
from fusion.stages.spc_register.result import (
    STATES_FILE,
    Placed,
    Placement,
    StatesResult,
    content_of,
)
from fusion.workspace import Workspace
from spcola import atomic
from spcola.arrays import AnyArray
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError, WorkspaceError
from spcola.formats.solution import write_summary
from spcola.imagematching.frames import FrameMatch, RenderedFrame, render_frame
from spcola.imagematching.frames.fitting import FittedFrame, FrameFitOptions, fit_frame
from spcola.shape import RayCaster

# Raised whenever equal input gives other states.
_VERSION = 3
# Least correlation with the rendered shape.
_FITS = 0.5
# Least share of lit ground that image and rendering have in common, of what either has at the best
# offset: 0.90 to 0.95 on comet 67P, 0.93 to 0.99 on synthetic bodies, 0.45 with a shape half as
# large again as the body.
_OVERLAP = 0.75
# By so much less than at the stated state the fit may correlate: edges of renderings are rough.
_WORSE = 0.005


@dataclass(frozen=True)
class RegisterOptions:
    """Which states are fitted, and how.

    Parameters
    ----------
    only : tuple of str
        Names of images; all that have pixels if empty.
    fit : FrameFitOptions
    """

    only: tuple[str, ...] = ()
    fit: FrameFitOptions = field(default_factory=FrameFitOptions)

    def as_json(self) -> dict[str, Any]:
        """Return them in JSON types."""
        return {
            "only": list(self.only),
            "position_sigma_m": self.fit.position_sigma,
            "photometry": self.fit.function.text,
        }


def register_states(
    workspace: Workspace,
    name: str,
    options: RegisterOptions,
    executor: Executor,
    progress: Progress,
    *,
    job: str = "",
) -> StatesResult:
    """Make a solution in which the states of images fit the shape; the parent stays as it is.

    Each image depends on its own state and pixels and on the shape alone. Finished ones are kept,
    so that an interrupted command goes on where it was.

    Parameters
    ----------
    workspace : Workspace
    name : str
        Of the new solution; empty: ``registered-1``, ``registered-2``, …
    options : RegisterOptions
    executor : Executor
    progress : Progress
    job : str, optional
        What asks for it, as the solution's record has it: the same one again gets the solution
        that it made before.

    Raises
    ------
    WorkspaceError
        If there is no shape, no image has both pixels and a state, a solution of that name is
        there, or something cannot be read or written.
    InvalidValueError
        If an image that is named has no pixels or no state.
    """
    if (made := solutions_of(workspace).of_job(job)) is not None:
        return StatesResult.read(workspace, made.name, made.parent, STATES_FILE)
    chosen = new_name(workspace, name, "registered")
    names = _images(workspace, options)
    if not workspace.has_shape():
        raise WorkspaceError(
            "has no shape to fit images to", workspace.root, "give one: spcola init --shape FILE"
        )
    started = time.time()
    items = ItemStore(item_folder(workspace.home, "spc-register"), whole_version(_VERSION))
    shape = workspace.shape_path()
    work = _Work(workspace, RayCaster(workspace.shape()), file_digest(shape), items, options.fit)
    facts: dict[str, Any] = {"register": options.as_json(), **({"job": job} if job else {})}
    digests = {f"{shape.parent.name}/{shape.name}": work.shape}
    made_by = MadeBy("spcola spc register", {}, facts, digests)
    with making_solution(workspace, chosen, made_by) as folder:
        found = _placed(work, names, folder, executor, progress)
        content = content_of(found, options.as_json())
        atomic.write_text(folder / STATES_FILE, json_text(content))
        facts |= {key: content[key] for key in ("outcomes", "correlation_start", "correlation")}
    if not options.only:
        items.remove_unused(started)
    return StatesResult.read(workspace, chosen, workspace.solution, STATES_FILE)


def _placed(
    work: _Work, names: list[str], folder: Path, executor: Executor, progress: Progress
) -> list[Placement]:
    """Fit images, write the states that are new, and return what was found."""
    found = []
    sizes = [float(np.prod(work.workspace.image(name).size)) for name in names]
    with progress.items("states of images", sizes, executor.workers) as task:
        for one, spent in executor.stream(Timed(work.place), names):
            if one.fitted is not None:
                path = work.workspace.image_path(one.name)
                write_summary(folder / "SUMFILES" / path.name, one.fitted.image, like=path)
            found.append(one)
            task.advance_one(spent)
    return found


def _images(workspace: Workspace, options: RegisterOptions) -> list[str]:
    """Return the names of images that have both pixels and a state."""
    known = [n for n in workspace.image_names() if workspace.exposure_path(n).is_file()]
    for name in options.only:
        if name not in known:
            raise InvalidValueError(
                f"there is no image {name!r} with pixels and a state", "--only", "see: spcola info"
            )
    if not known:
        raise WorkspaceError(
            "no image has both pixels and a state",
            workspace.root / "IMAGEFILES",
            "bring images and states: spcola images",
        )
    return [name for name in known if not options.only or name in options.only]


@dataclass(frozen=True, eq=False)
class _Work:
    """Fits one image after another.

    Parameters
    ----------
    workspace : Workspace
    caster : RayCaster
        Of the shape.
    shape : str
        Digest of the shape.
    items : ItemStore
    options : FrameFitOptions
    """

    workspace: Workspace
    caster: RayCaster
    shape: str
    items: ItemStore
    options: FrameFitOptions

    def place(self, name: str) -> Placement:
        """Return the fit of an image; a kept one if nothing that goes into it changed."""
        image = self.workspace.image(name)
        paths = self.workspace.image_path(name), self.workspace.exposure_path(name)
        # A camera file that the state names is not in its digest.
        found: Placement = self.items.result(
            self.from_pixels, name, *map(file_digest, paths), image.camera, self.shape, self.options
        )
        return found

    def from_pixels(self, name: str, *_inputs: object) -> Placement:
        """Return the fit of an image whose state, pixels, camera and shape are those given."""
        image = self.workspace.exposed(self.workspace.image(name))
        assert image.pixels is not None
        away = float(np.linalg.norm(image.position))
        rendered = render_frame(self.caster, image, step=step_of(image.size, COARSE))
        if not rendered.brightness.any():
            return Placement(name, Placed.NO_GROUND, float("nan"), away, None)
        match = match_frame(image, image.pixels, rendered)
        outcome, fitted = self._fitted(image, image.pixels, rendered, match)
        # The match has coarser cells, which correlate otherwise than those of the fit.
        start = match.given if fitted is None else fitted.correlation_start
        return Placement(name, outcome, start, away, fitted)

    def _fitted(
        self, image: SpcImage, pixels: AnyArray, rendered: RenderedFrame, match: FrameMatch
    ) -> tuple[Placed, FittedFrame | None]:
        """Return how the fit ended, and the new state where it is to be used."""
        if better_turn(image, pixels, rendered, match) is not None:
            return Placed.TURNED, None
        like = match.correlation >= _FITS and match.overlap >= _OVERLAP
        if not (like and is_distinct(pixels, rendered, match)):
            return Placed.UNLIKE, None
        try:
            fitted = fit_frame(image, self.caster, match=match, options=self.options)
        except InvalidValueError:
            return Placed.NO_GROUND, None
        if fitted.correlation < fitted.correlation_start - _WORSE:
            return Placed.UNLIKE, None
        if not fitted.settled:
            return Placed.NOT_SETTLED, None
        return Placed.FITTED, replace(fitted, image=replace(fitted.image, pixels=None))
