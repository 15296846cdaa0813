"""Images whose files cannot be theirs: they are left out before anything is solved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from fusion.stages.bad_images.outlines import Outline
from fusion.stages.register import ImageScene
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.errors import WorkspaceError
from spcola.formats.images.depth import bytes_by_content

__all__ = ["no_usable_image", "with_right_sizes"]


def with_right_sizes(scene: ImageScene) -> tuple[ImageScene, dict[str, str]]:
    """Return a scene without images whose file does not have the size of their .SUM, and these.

    They are found before the first ground that would need one, by the lengths of the files, and by
    a few lines of them: half of an image, and one of twice as many pixels, may fit the .SUM with
    another number of bytes a pixel.

    Parameters
    ----------
    scene : ImageScene

    Returns
    -------
    scene : ImageScene
    wrong : dict of str to str
        Of the images that are left out both sizes in words.
    """
    wrong = _wrong_sizes(scene.workspace, scene.images)
    images = tuple(image for image in scene.images if image.name not in wrong)
    return replace(scene, images=images), wrong


def _wrong_sizes(workspace: Workspace, images: Iterable[SpcImage]) -> dict[str, str]:
    """Return the images, with a file in IMAGEFILES, of another size than their .SUM states."""
    found = dict[str, str]()
    for image in images:
        path = workspace.exposure_path(image.name)
        length, (width, height) = path.stat().st_size, image.size
        # One or two bytes a pixel.
        if length not in (width * height, 2 * width * height):
            found[image.name] = (
                f"{length} bytes, where {width} × {height} pixels need {width * height} or twice "
                "that"
            )
        elif bytes_by_content(path, width, height) not in (0, length // (width * height)):
            found[image.name] = _wrong_depth(length, width, height)
    return found


def _wrong_depth(length: int, width: int, height: int) -> str:
    """Return what a file is taken for, by its length, and what it seems to be."""
    taken, seems = ("one byte", "two bytes") if length == width * height else ("two bytes", "one")
    pixels = length if seems == "one" else length // 2
    return (
        f"{length} bytes, {taken} for each of {width} × {height} pixels, but they look like "
        f"{pixels} pixels of {seems}: NPX and NLN of another image, or half of the file is missing"
    )


def no_usable_image(
    workspace: Workspace, wrong: Mapping[str, str], outline: Outline
) -> WorkspaceError:
    """Return the error of a workspace none of whose images can be used.

    Parameters
    ----------
    workspace : Workspace
    wrong : mapping of str to str
        As :func:`with_right_sizes` has them.
    outline : Outline
        What images should show.
    """
    images = [one for one in workspace.images() if workspace.exposure_path(one.name).is_file()]
    right = [one for one in images if one.name not in wrong]
    if wrong and not right:
        name, words = next(iter(wrong.items()))
        return WorkspaceError(
            f"no image file has the size of its .SUM; {name} has {words}",
            workspace.root / "IMAGEFILES",
            "bring pixels and states of the same images: spcola images",
        )
    others = f" ({len(wrong)} of another size than their .SUM)" if wrong else ""
    for image in right:
        if (problem := outline.body.problem(image)) is not None:
            likely = ", or ".join(one.text for one in outline.body.mistakes(image))
            return WorkspaceError(
                f"by the state of {image.name}, {problem.text}, and no other image can be used"
                f"{others}",
                workspace.image_path(image.name),
                f"{f'likely {likely}: ' if likely else ''}make states anew: spcola sumfiles",
            )
    return WorkspaceError(
        "no image has both pixels and a state of known uncertainty",
        workspace.root / "IMAGEFILES",
        "bring images and states: spcola images",
    )
