"""Maplets solved from images: goodness of fit, and their images next to renderings."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from functools import lru_cache
from typing import Any

from fusion.report.photoclinometry import (
    goodness_index,
    image_strip,
    read_goodness,
    residual_limit,
    strip_png,
)
from fusion.report.photoclinometry.albedo import goodness_path
from fusion.report.photoclinometry.around import around_caster, around_files
from fusion.runtime import content_digest
from fusion.service.views.body import PAGE_FACETS, shape_mesh
from fusion.service.views.surfaces import LayerCache
from fusion.service.views.surfaces.cache import Stamp, stamp_of
from fusion.workspace import Workspace
from spcola.arrays import AnyArray
from spcola.errors import WorkspaceError
from spcola.photometry.secondary_light import name_of_image
from spcola.shape import RayCaster

__all__ = ["solved_etag", "solved_index", "solved_maplet", "solved_picture"]

_MAKING = threading.Lock()


def solved_index(workspace: Workspace) -> dict[str, Any]:
    """Return the goodness of fit of each maplet and image of a solution from images.

    Parameters
    ----------
    workspace : Workspace

    Returns
    -------
    dict
        As of :func:`fusion.report.photoclinometry.goodness_index`, and the name of the `solution`.

    Raises
    ------
    WorkspaceError
        If the solution has no maplets from images, or what is known of them cannot be read.
    FormatError
        If it lacks what is shown.
    """
    return {"solution": workspace.solution, **goodness_index(_content(workspace))}


def solved_maplet(workspace: Workspace, maplet: str) -> dict[str, Any]:
    """Return how a maplet was solved, round by round, and how each of its images fits.

    Parameters
    ----------
    workspace : Workspace
    maplet : str

    Returns
    -------
    dict
        What ``photoclinometry.json`` has of it, `images` and `constraints` as lists with `name`;
        `solution`, `name`, `gsd_m`; `findings` that name it or one of its images;
        `residual_limit`: up to which residual pictures of residuals have colours.

    Raises
    ------
    WorkspaceError
        If it was not solved from images.
    """
    content = _content(workspace)
    one = _maplet(workspace, content, maplet)
    concerned = {maplet, *one["images"]}
    return {
        "solution": workspace.solution,
        "name": maplet,
        **one,
        "gsd_m": workspace.maplet(maplet).grid.gsd,
        **{
            kind: [{"name": name, **fit} for name, fit in one.get(kind, {}).items()]
            for kind in ("images", "constraints")
        },
        "findings": [
            {**found, "names": named}
            for found in content["findings"]
            if (named := [name for name in found["names"] if name in concerned])
        ],
        "residual_limit": residual_limit(one),
    }


def solved_picture(
    workspace: Workspace, maplet: str, image: str, *, cache: LayerCache | None = None
) -> bytes:
    """Return an image on the grid of a maplet, its rendering and the residual, as a PNG.

    Parameters
    ----------
    workspace : Workspace
    maplet, image : str
        Names.
    cache : LayerCache, optional

    Raises
    ------
    WorkspaceError
        If the maplet was not solved from images, or not from this one.
    SpcolaError
        If a file cannot be read.
    """
    content, kept = _content(workspace), cache or LayerCache()
    _image(workspace, content, maplet, image)

    def make() -> dict[Hashable, AnyArray]:
        one, others = workspace.maplet(maplet), _around_stamp(workspace, content, maplet)
        beyond = around = None
        # Pictures of a maplet are asked for together: the first makes what all of them need.
        with _MAKING:
            if workspace.has_shape():
                beyond = _caster(workspace, stamp_of(workspace.shape_path()), kept)
            if others:
                around = _around(workspace, maplet, one.grid.gsd, others)
        return {"codes": image_strip(workspace, content, one, image, beyond, around)}

    return strip_png(kept.find(_key(workspace, content, maplet, image), "codes", make))


def solved_etag(workspace: Workspace, maplet: str, image: str) -> str:
    """Return a text that changes whenever :func:`solved_picture` does; raises as it does."""
    content = _content(workspace)
    _image(workspace, content, maplet, image)
    return content_digest(repr(_key(workspace, content, maplet, image)))[:32]


def _key(
    workspace: Workspace, content: dict[str, Any], maplet: str, image: str
) -> tuple[Hashable, ...]:
    """Return what a picture is made from."""
    own = name_of_image(image) or image
    paths = [
        goodness_path(workspace), workspace.maplet_path(maplet), workspace.image_path(own),
        workspace.exposure_path(own), *([workspace.shape_path()] if workspace.has_shape() else []),
    ]  # fmt: skip
    around = _around_stamp(workspace, content, maplet)
    return ("solved", image, stamp_of(*(path for path in paths if path.is_file())), around)


def _around_stamp(workspace: Workspace, content: dict[str, Any], maplet: str) -> Stamp:
    """Return what changes with the maplets around one; empty if there are none."""
    return stamp_of(*around_files(workspace, content["maplets"][maplet]))


def _content(workspace: Workspace) -> dict[str, Any]:
    path = goodness_path(workspace)
    if not path.is_file():
        do = f"run: spcola spc lithos {workspace.root}"
        raise WorkspaceError("is not there: no maplet of the solution is from images", path, do)
    return _read(workspace, stamp_of(path))


@lru_cache(maxsize=1)
def _read(workspace: Workspace, stamp: Stamp) -> dict[str, Any]:  # noqa: ARG001
    """Return the content of the file; it has megabytes, and each picture needs it."""
    return read_goodness(workspace) or {}


def _maplet(workspace: Workspace, content: dict[str, Any], maplet: str) -> dict[str, Any]:
    if maplet not in content["maplets"]:
        what = f"no maplet {maplet!r} was solved from images"
        raise WorkspaceError(what, workspace.root, "list those that were")
    found: dict[str, Any] = content["maplets"][maplet]
    return found


def _image(workspace: Workspace, content: dict[str, Any], maplet: str, image: str) -> None:
    """Raise an error unless a maplet was solved from an image."""
    if image not in _maplet(workspace, content, maplet)["images"]:
        what = f"maplet {maplet!r} was not solved from an image {image!r}"
        raise WorkspaceError(what, workspace.root, "list those from which it was")


@lru_cache(maxsize=1)
def _caster(workspace: Workspace, stamp: Stamp, cache: LayerCache) -> RayCaster:  # noqa: ARG001
    """Return the shape for the shadows that it casts; coarse where it has very many facets."""
    return RayCaster(shape_mesh(workspace, PAGE_FACETS, cache=cache))


@lru_cache(maxsize=2)
def _around(
    workspace: Workspace,
    maplet: str,
    gsd: float,
    stamp: Stamp,  # noqa: ARG001
) -> RayCaster | None:
    """Return the maplets around one, for what they hide and shade."""
    return around_caster(workspace, _content(workspace)["maplets"][maplet], gsd)
