"""What the service reads of maplets solved from images, and that it is as described."""

from __future__ import annotations

import json

import numpy as np
import pytest
from solved_workspace import FAR, MAPLET, REVERSED

from fusion.client import connect
from fusion.runtime import json_value
from fusion.service.api.schemas.solved import SolvedIndex, SolvedMaplet
from fusion.service.views.photoclinometry import (
    solved_etag,
    solved_index,
    solved_maplet,
    solved_picture,
)
from fusion.service.views.surfaces import SurfaceKind, colours_of, open_surface, value_at
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError
from spcola.formats.slope_directions import read_slope_directions, slope_directions_path


@pytest.fixture
def workspace(solved) -> Workspace:
    return Workspace.open(solved[0])


def test_answers_are_as_described(workspace) -> None:
    index = json_value(solved_index(workspace))
    SolvedIndex.model_validate(index)
    assert [one["name"] for one in index["maplets"]] == [MAPLET, FAR]
    for name in (MAPLET, FAR):
        SolvedMaplet.model_validate(json_value(solved_maplet(workspace, name)))
    one = solved_maplet(workspace, MAPLET)
    assert one["gsd_m"] == pytest.approx(0.5)
    assert [(found["code"], found["names"]) for found in one["findings"]] == [
        ("sun-reversed", [REVERSED])
    ]
    assert len(one["rounds"]) >= 3


def test_a_session_reads_the_same(workspace) -> None:
    with connect(str(workspace.root.parent)) as session:
        index = session.photoclinometry("waves", solution="images")
        one = session.photoclinometry("waves", MAPLET)
    assert index == json.loads(json.dumps(json_value(solved_index(workspace))))
    assert one["outcome"] == "converged"


def test_pictures_and_their_tags(workspace) -> None:
    tags = {solved_etag(workspace, MAPLET, image) for image in ("I0", "I1")}
    assert len(tags) == 2
    assert solved_picture(workspace, MAPLET, "I0")[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_solved_maplet_has_the_directions_of_slopes_as_a_layer(workspace) -> None:
    surface = open_surface(workspace, SurfaceKind.MAPLET, MAPLET)
    assert "directions" in surface.layers
    size = (0, surface.grid.size)
    values = surface.window("directions", rows=size, columns=size)
    path = slope_directions_path(workspace.maplet_path(MAPLET))
    found = read_slope_directions(path, surface.grid.half_size)
    np.testing.assert_array_equal(values, found.count_at_points.T)
    assert surface.range("directions") == (0.0, 2.0)
    value = value_at(surface, 0.0, 0.0)["layers"]["directions"]
    assert value == found.count_at_points[surface.grid.half_size, surface.grid.half_size]
    table = np.array(colours_of("directions"))
    np.testing.assert_array_equal(table[[0, 127, 254]], [[187] * 3, [230, 159, 0], [0, 114, 178]])
    assert "directions" not in open_surface(workspace, SurfaceKind.MAPLET, FAR).layers


def test_what_is_not_there_is_named(workspace) -> None:
    with pytest.raises(WorkspaceError, match="no maplet 'XX' was solved"):
        solved_maplet(workspace, "XX")
    with pytest.raises(WorkspaceError, match=r"was not solved from an image '\.\./I0'"):
        solved_picture(workspace, MAPLET, "../I0")
    with pytest.raises(WorkspaceError, match="no maplet of the solution is from images"):
        solved_index(Workspace.open(workspace.root, "imported"))
