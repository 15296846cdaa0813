"""Landmarks of mapolas that have become maplets, and the lists and states that name them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fusion.stages.albedo.placing import PlacedMapola
from fusion.workspace import Workspace
from spcola.camera import ImagePoint
from spcola.control import Landmark, overlaps_of
from spcola.formats.solution import write_landmark, write_list, write_summary


def write_landmarks(workspace: Workspace, folder: Path, placed: Sequence[PlacedMapola]) -> None:
    """Write .LMK files, lists, and the .SUM of images in which a centre was measured.

    Landmarks that were there before get the new ones as overlaps, and stay as they are else.

    Parameters
    ----------
    workspace : Workspace
        Of the parent.
    folder : Path
        Of the new solution.
    placed : sequence of PlacedMapola
    """
    new = {one.maplet.name: one.maplet.grid for one in placed}
    before = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
    overlaps = dict(zip([*new, *before], overlaps_of({**new, **before}), strict=True))
    for one in placed:
        maplet = one.maplet
        landmark = Landmark(
            maplet.name,
            maplet.grid,
            sigma=maplet.center_sigma,
            prior_sigma=float(maplet.center_sigma.max()),
            pictures=one.pictures,
            overlaps=overlaps[maplet.name],
        )
        write_landmark(folder / "LMKFILES" / f"{maplet.name}.LMK", landmark)
    for name in workspace.landmark_names():
        if added := tuple(near for near in overlaps.get(name, ()) if near.name in new):
            known, path = workspace.landmark(name), workspace.landmark_path(name)
            known = replace(known, overlaps=(*known.overlaps, *added))
            write_landmark(folder / "LMKFILES" / path.name, known, like=path)
    for listing, names in (
        ("MAPLIST.TXT", workspace.maplet_names()),
        ("LMRKLIST.TXT", workspace.landmark_names()),
    ):
        write_list(folder / listing, [*names, *new], kind="landmark")
    _write_states(workspace, folder, placed)


def _write_states(workspace: Workspace, folder: Path, placed: Sequence[PlacedMapola]) -> None:
    """Write the states of images with the landmarks that were measured in them."""
    seen = defaultdict[str, list[ImagePoint]](list)
    for one in placed:
        for point in one.pictures if one.measured else ():
            seen[point.name].append(replace(point, name=one.maplet.name))
    for name, points in seen.items():
        image, path = workspace.image(name), workspace.image_path(name)
        known = replace(image, landmarks=(*image.landmarks, *points))
        write_summary(folder / "SUMFILES" / path.name, known, like=path)
