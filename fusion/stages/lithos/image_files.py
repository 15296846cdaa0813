"""Images whose files cannot be theirs: they are left out before anything is solved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from fusion.stages.lithos.outlines import Outline
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.errors import WorkspaceError

__all__ = ["no_usable_image", "wrong_sizes"]


def wrong_sizes(workspace: Workspace, images: Iterable[SpcImage]) -> dict[str, str]:
    """Return the images whose file does not have the size of their .SUM, and both in words.

    Files are not read: one is found before the first maplet that would need it.

    Parameters
    ----------
    workspace : Workspace
    images : iterable of SpcImage
        With a file in IMAGEFILES.
    """
    found = dict[str, str]()
    for image in images:
        length = workspace.exposure_path(image.name).stat().st_size
        width, height = image.size
        # One or two bytes a pixel.
        if length not in (width * height, 2 * width * height):
            found[image.name] = (
                f"{length} bytes, where {width} × {height} pixels need {width * height} or twice "
                "that"
            )
    return found


def no_usable_image(
    workspace: Workspace, wrong: Mapping[str, str], outline: Outline
) -> WorkspaceError:
    """Return the error of a workspace none of whose images can be used.

    Parameters
    ----------
    workspace : Workspace
    wrong : mapping of str to str
        As :func:`wrong_sizes` has them.
    outline : Outline
        What images should show.
    """
    if wrong:
        name, words = next(iter(wrong.items()))
        return WorkspaceError(
            f"no image file has the size of its .SUM; {name} has {words}",
            workspace.root / "IMAGEFILES",
            "bring pixels and states of the same images: spcola images",
        )
    exposed = (one for one in workspace.images() if workspace.exposure_path(one.name).is_file())
    for image in exposed:
        if (problem := outline.body.problem(image)) is not None:
            likely = ", or ".join(one.text for one in outline.body.mistakes(image))
            return WorkspaceError(
                f"by the state of {image.name}, {problem.text}, and no other image can be used",
                workspace.image_path(image.name),
                f"{f'likely {likely}: ' if likely else ''}make states anew: spcola sumfiles",
            )
    return WorkspaceError(
        "no image has both pixels and a state of known uncertainty",
        workspace.root / "IMAGEFILES",
        "bring images and states: spcola images",
    )
