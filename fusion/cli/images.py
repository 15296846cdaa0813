"""``spcola images``."""

from __future__ import annotations

from dataclasses import replace

from fusion.cli.folder import remember_info
from fusion.cli.options import WorkOptions, WorkspaceArgument, shared_path
from fusion.cli.output import show
from fusion.service.commands.images import ImagesOptions, bring_images


def images(
    workspace: WorkspaceArgument,
    given: ImagesOptions = ImagesOptions(),
    work: WorkOptions = WorkOptions(),
) -> None:
    """Bring images into the workspace: pixels, and states where a source is named.

    Pixels are written to IMAGEFILES, states to SUMFILES and NOMINALS of the solution, and
    images.jsonl keeps each image's original name, file, digest, label, and where its state and
    camera come from. Nothing that is there is replaced; an image that is there already is
    recognised by its content. An interrupted import goes on where it was. The workers of a cluster
    must reach the images under the same path too.
    """
    files = [shared_path(file, work.cluster) for file in given.files or ()]
    given = replace(given, files=files)
    given.check()
    show(*bring_images(work.site(workspace), given), as_json=work.as_json)
    remember_info(workspace)
