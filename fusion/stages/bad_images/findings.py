"""Images that no ground could use because something is wrong with them, and what to do."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.stages.bad_images.outlines import Outline, pixels_at
from fusion.stages.register import ImageScene
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.grids import MapletGrid
from spcola.imagematching.frames.mistakes import Mistake, ViewProblem
from spcola.photometry.photoclinometry import Fit, ImageFit

# Share of the pixels of a frame below which those between the thresholds are hot pixels or noise.
_FEW = 1e-4
# Share of the pixels on the ground of an image from which on they are saturated.
_SATURATED = 0.9
# Points along the side of ground that are looked up in an image.
_LATTICE = 9

_ANEW = "make their states anew: spcola sumfiles"


@dataclass(frozen=True, eq=False)
class ImageUse:
    """Ground that was solved, and the images from which it was.

    Parameters
    ----------
    scene : ImageScene
        Images that could be used.
    whole : sequence of MapletGrid
        All ground of the workspace that images may show.
    solved : mapping of str to MapletGrid
        Ground that was solved, by name.
    fits : mapping of str to sequence of ImageFit
        How each image that was chosen for it fits each of it.
    wrong_size : mapping of str to str
        Images that were left out, as their files do not have the size of their .SUM; both in words.
    secondary : sequence of str
        Images that count in the shade, and need to show nothing in the light of the Sun.
    ground : str
        What people call it, in the plural.
    """

    scene: ImageScene
    whole: Sequence[MapletGrid]
    solved: Mapping[str, MapletGrid]
    fits: Mapping[str, Sequence[ImageFit]]
    wrong_size: Mapping[str, str]
    secondary: Sequence[str] = ()
    ground: str = "maplets"


def image_findings(use: ImageUse) -> Iterator[dict[str, Any]]:
    """Yield what is wrong with images that no ground could use: `code`, `names`, `do`.

    Images that show other ground of the body are right, and are not named.

    Parameters
    ----------
    use : ImageUse
    """
    yield from _size_findings(use.wrong_size)
    yield from _state_findings(use)
    yield from _pixel_findings(use)


def state_findings(
    outline: Outline,
    images: Iterable[SpcImage],
    looks_reversed: Sequence[str] = (),
    ground: str = "maplets",
) -> Iterator[dict[str, Any]]:
    """Yield images whose states let them show no ground, or none in the light of the Sun.

    Parameters
    ----------
    outline : Outline
    images : iterable of SpcImage
    looks_reversed : sequence of str
        Names of those whose pixels show that the Sun is on the other side.
    ground : str
        What people call it, in the plural.
    """
    named = defaultdict[tuple[ViewProblem, tuple[Mistake, ...]], list[str]](list)
    for image in images:
        problem = outline.body.problem(image)
        if problem is not None and image.name not in looks_reversed:
            named[problem, outline.body.mistakes(image)].append(image.name)
    if looks_reversed:
        yield {
            "code": str(Fit.SUN_REVERSED),
            "names": list(looks_reversed),
            "do": f"by their states no {ground} have usable light, but they are bright where light "
            f"from the other side would fall: {Mistake.SUN_REVERSED.text}; {_ANEW}",
        }
    for (problem, likely), names in named.items():
        cause = ", or ".join(one.text for one in likely)
        yield {"code": str(problem), "names": names, "do": _what_to_do(problem, cause)}


def _what_to_do(problem: ViewProblem, cause: str) -> str:
    """Return what contradicts the body, the likely mistakes, and what to do."""
    first, likely = f"by their states {problem.text}", f"likely {cause}: " if cause else ""
    if problem is ViewProblem.NIGHT:
        # Images of the night side exist, and contradict nothing.
        return f"{first}; if they show lit ground, {likely}{_ANEW}; else leave them out"
    return f"{first}; {likely}{_ANEW}, or leave them out"


def _size_findings(wrong: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    if wrong:
        name, words = next(iter(wrong.items()))
        yield {
            "code": "image-size",
            "names": list(wrong),
            "do": f"their files in IMAGEFILES do not have the size of their .SUM ({name}: {words}) "
            "and were left out: bring pixels and states of the same images: spcola images",
        }


def _state_findings(use: ImageUse) -> Iterator[dict[str, Any]]:
    """Yield findings of the states of images that none of the solved ground uses."""
    scene = use.scene
    # Those whose states let the scene leave them out, too.
    known = {image.name: image for image in scene.images}
    used = {fit.name for fits in use.fits.values() for fit in fits}
    used |= {*use.secondary, *use.wrong_size}
    unused = [
        known[name] if name in known else scene.workspace.image(name)
        for name in scene.workspace.image_names()
        if name not in used and scene.workspace.exposure_path(name).is_file()
    ]
    if not unused:
        return
    outline = Outline.of(scene.beyond, use.whole)
    solved = Outline.of(None, use.solved.values())
    # Only images that might show the ground in the light of another Sun are read.
    looks_reversed = [
        image.name
        for image in unused
        if image.name in known
        and solved.mostly_dark(image, scene.choice)
        and outline.lit_from_the_other_side(scene.exposed(image), scene.choice)
    ]
    yield from state_findings(outline, unused, looks_reversed, use.ground)


def _pixel_findings(use: ImageUse) -> Iterator[dict[str, Any]]:
    """Yield images that were not seen on any of their ground, and cannot be: dark, saturated."""
    known = {image.name: image for image in use.scene.images}
    shown = defaultdict[str, list[str]](list)
    for one, fits in use.fits.items():
        for fit in fits:
            shown[fit.name].append(one)
    seen = {fit.name for fits in use.fits.values() for fit in fits if fit.fit is not Fit.NOT_SEEN}
    named: dict[str, list[str]] = {"dark": [], "saturated": []}
    for name in sorted(known.keys() & shown.keys() - seen):
        image = use.scene.exposed(known[name])
        if kind := unusable(image, [use.solved[one] for one in shown[name]]):
            named[kind].append(name)
    words = {
        "dark": "all their pixels are as dark as shadow, by the first of THRSH in their .SUM",
        "saturated": "their pixels are saturated, by the second of THRSH in their .SUM",
    }
    for kind, names in named.items():
        if names:
            do = f"{words[kind]}: check THRSH, file and exposure, or leave them out"
            yield {"code": "image-unusable", "names": names, "do": do}


def unusable(image: SpcImage, grids: Iterable[MapletGrid]) -> str:
    """Return why no pixel of an image can be used: "dark" or "saturated"; empty if some can.

    Parameters
    ----------
    image : SpcImage
        With pixels.
    grids : iterable of MapletGrid
        Of the ground that it shows.
    """
    assert image.pixels is not None
    low, high = image.thresholds
    usable = (image.pixels > low) & (image.pixels < high)
    if float(np.mean(usable)) <= _FEW:
        return "saturated" if np.mean(image.pixels >= high) > 0.5 else "dark"
    # Dark ground may be in shadow, but shadows are never saturated.
    values = np.concatenate([_values_on(image, grid) for grid in grids])
    return "saturated" if values.size and np.mean(values >= high) >= _SATURATED else ""


def _values_on(image: SpcImage, grid: MapletGrid) -> FloatArray:
    """Return the pixels (N,) of an image at points of a grid, those in the frame."""
    steps = np.linspace(-grid.half_size, grid.half_size, _LATTICE) * grid.gsd
    points = grid.center + (steps[:, None, None] * grid.uy + steps[None, :, None] * grid.ux)
    return pixels_at(image, points.reshape(-1, 3))[1]
