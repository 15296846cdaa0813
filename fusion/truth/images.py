"""The images of a synthetic mission: rendered from the true states, written with nominal ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np

from fusion.truth.ground import ground_at
from fusion.truth.work import Work, missing
from spcola.camera import SpcImage
from spcola.truth.campaign.states import SolvedState
from spcola.truth.imaging import render_image, write_image
from spcola.truth.sampled import SampledSurface

FINEST = 0.05
"""Finest sampling of the surface for images, metres: as the truth of Weirich et al."""
SURFACE_BYTES = 2**30
"""Most memory of that surface, bytes."""


def write_images(work: Work, states: Sequence[SolvedState]) -> None:
    """Render and write the images: ``.DAT`` into the SPC folder, FITS into ``images/``.

    Images of similar pixel size on the surface share a sampled surface, one after the other, so
    that only one is in memory. The sampling depends on the image alone.
    """
    wanted = [state for state in states if any(map(missing, files_of_image(work, state)))]
    wanted.sort(key=lambda state: spacing_of(state.truth, work.settings.body.radius))
    with work.progress.task("images", len(states)) as task:
        task.advance(len(states) - len(wanted))
        for spacing, group in groupby(
            wanted, lambda state: spacing_of(state.truth, work.settings.body.radius)
        ):
            surface = ground_at(work.settings.body, spacing, memory_bytes=SURFACE_BYTES)
            for _ in work.executor.stream(partial(_write, work, surface), group):
                task.advance()


def files_of_image(work: Work, state: SolvedState) -> list[Path]:
    """Return the files of an image."""
    name = state.truth.name
    places = {
        "dat": work.site.spc / "IMAGEFILES" / f"{name}.DAT",
        "fits": work.site.images / f"{name}.fits",
    }
    return [places[kind] for kind in work.settings.image_formats]


def spacing_of(image: SpcImage, radius: float) -> float:
    """Return the sampling of the surface for an image, metres.

    It is a power of two, and at most the size of a pixel at the nearest point of the surface.
    """
    distance = float(np.linalg.norm(image.position)) - radius
    pixel = image.camera.pixel_angle * max(distance, 0.0)
    return max(FINEST, 2.0 ** np.floor(np.log2(max(pixel, FINEST))))


def _write(work: Work, surface: SampledSurface, state: SolvedState) -> None:
    """Render one image with its true state, and write it with its nominal state."""
    settings = work.settings.imaging
    name = state.truth.name
    generator = work.random(f"image {name}")
    rendered = render_image(surface, work.body, state.truth, settings=settings, generator=generator)
    known = _as_known(state)
    for kind, path in zip(work.settings.image_formats, files_of_image(work, state), strict=True):
        if missing(path):
            write_image(path.parent, name, rendered, known, formats=[kind], settings=settings)


def _as_known(state: SolvedState) -> SpcImage:
    """Return the image with its nominal state, from navigation."""
    nominal = state.nominal
    return replace(
        state.solved,
        scobj=nominal.scobj,
        axes=nominal.axes,
        scobj_sigma=nominal.scobj_sigma,
        pointing_sigma=nominal.pointing_sigma,
    )
