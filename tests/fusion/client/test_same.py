"""Every call on a server and on the folder that it serves: the same to the bit."""

from __future__ import annotations

import asyncio
import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from served import MAPLETS
from server_process import ServerProcess

from fusion.client import AsyncSession, Session, Window, connect_async
from fusion.client.local import _CONTENTS, _VIEWS
from fusion.client.place import View
from fusion.client.reading import Reading
from fusion.client.steps import call
from fusion.client.surfaces import Surfaces
from spcola.errors import SpcolaError

ONE = ("ball", "fused", "AA0001")
WINDOW = {"window": Window(level=2, rows=(3, 90), columns=(0, 151))}
CALLS: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = [
    ("workspaces", (), {}),
    ("overview", ("ball",), {}),
    ("overview", ("nothing",), {}),
    ("overview", ("../ball",), {}),
    ("overview", ("ball",), {"solution": "nothing"}),
    ("coverage", ("ball",), {"step_deg": 30.0}),
    ("coverage", ("ball",), {"step_deg": 7.0}),
    *(("items", ("ball", kind), {}) for kind in ("scans", "maplets", "fused", "nothing")),
    *(("result", ("ball", name), {}) for name in ("registration", "manifest", "nothing")),
    ("residuals", ("ball",), {}),
    ("epsilon", ("ball",), {}),
    ("photoclinometry", ("ball",), {}),
    ("photoclinometry", ("ball", "AA0001"), {}),
    ("solutions", ("ball",), {}),
    ("solution", ("ball", "imported"), {}),
    ("solution", ("ball", "nothing"), {}),
    ("solutions_compared", ("ball", "imported", "imported"), {}),
    ("outputs", ("ball",), {}),
    ("runs", ("ball",), {}),
    ("run", ("ball", "imported:mapolas"), {}),
    ("runs_compared", ("ball", "imported:mapolas", "imported:mapolas"), {}),
    ("runs_compared", ("ball", "imported:mapolas", "imported:mapolas"), {"other": "nothing"}),
    ("provenance", ("ball", "mapolas/AA0001.MAP"), {}),
    ("tables", ("ball",), {}),
    ("table", ("ball", "registration-mapolas"), {}),
    ("table", ("ball", "nothing"), {}),
    ("surfaces", ("ball",), {}),
    ("surfaces", ("ball", "maplet"), {}),
    ("surfaces", ("ball", "nothing"), {}),
    ("surface", ONE, {}),
    ("window", ONE, {}),
    ("window", (*ONE, "slope"), {}),
    ("window", (*ONE, "sigma"), WINDOW),
    ("window", (*ONE, "nothing"), {}),
    ("window", ONE, {"window": Window(level=3)}),
    ("window", ("ball", "fused", "nothing"), {}),
    ("layers", ONE, WINDOW),
    ("value", (*ONE, 0.5, -0.25), {}),
    ("value", (*ONE, 1e6, 0.0), {}),
    ("profile", (*ONE, (0.0, 0.0), (3.0, 2.0)), {"layers": ("height", "sigma")}),
    ("outlines", ("ball", "maplet"), {}),
    ("outlines", ("ball", "nothing"), {}),
    ("shape", ("ball",), {}),
    ("shape_layers", ("ball",), {}),
    ("shape_layer", ("ball", "sigma"), {}),
]


@pytest.fixture(scope="module", autouse=True)
def mapolas(remote: Session) -> None:
    remote.wait(remote.submit("ball", ["mapolas"]), progress=False)


def outcome(session: Session, name: str, args: Any, options: Any) -> Any:
    """What a call returns, or the class and the code of its error."""
    try:
        return getattr(session, name)(*args, **options)
    except SpcolaError as error:
        return type(error), getattr(error, "code", None)


def assert_same(found: Any, wanted: Any) -> None:
    assert type(found) is type(wanted)
    if isinstance(found, dict):
        assert list(found) == list(wanted)
        for key in found:
            assert_same(found[key], wanted[key])
    elif isinstance(found, np.ndarray):
        assert found.dtype == wanted.dtype
        np.testing.assert_array_equal(found, wanted)
    elif hasattr(found, "about"):
        assert_same(vars(found), vars(wanted))
    else:
        assert found == wanted


@pytest.mark.parametrize(("name", "args", "options"), CALLS)
def test_local_and_remote_are_the_same(
    remote: Session, local: Session, name: str, args: Any, options: Any
) -> None:
    assert_same(outcome(local, name, args, options), outcome(remote, name, args, options))


def test_every_call_that_reads_is_compared() -> None:
    both = vars(Reading) | vars(Surfaces)
    there = {name for name, one in both.items() if isinstance(one, call)}
    # A dataset is made of the arrays of `layers`.
    assert there - {"dataset"} == {name for name, *_ in CALLS}
    assert _VIEWS.keys() | _CONTENTS.keys() == set(View)


def test_what_is_there_is_not_only_errors(local: Session) -> None:
    assert local.overview("ball")["maplets"] == MAPLETS
    heights = local.window(*ONE)
    assert heights.shape == (301, 301)
    assert np.isnan(heights[20, 5:9]).all()
    found = local.layers(*ONE, ["height"], window=Window(level=2))
    # The grid point in the middle is the first of its cell; the last cell has one point.
    assert found.x[[0, 75, -1]] == pytest.approx([-149.5 * 0.3, 0.5 * 0.3, 45.0])
    assert found.y[0] == -found.x[0]


def test_a_dataset_has_coordinates_units_and_a_crs(remote: Session) -> None:
    pytest.importorskip("xarray")
    found = remote.dataset(*ONE, ["height", "count"])
    assert found["height"].attrs["units"] == "m"
    assert found["height"].sel(x=0.0, y=0.0).item() == pytest.approx(150 / 1e4 + 2.25, abs=1e-4)
    assert found["crs"].attrs["crs_wkt"].startswith('ENGCRS["plane of fused AA0001"')
    axes = [found["crs"].attrs[name] for name in ("ux", "uy", "uz")]
    assert np.array(axes) @ np.array(axes).T == pytest.approx(np.eye(3), abs=1e-6)


def test_the_calls_are_awaited_in_the_same_way(
    server: ServerProcess, missions: Path, remote: Session
) -> None:
    async def asked(place: str | Path) -> list[Any]:
        async with await connect_async(place) as session:
            assert isinstance(session, AsyncSession)
            windows = [session.window(*ONE, layer) for layer in ("height", "sigma", "slope")]
            job = (await session.jobs("ball"))[-1]
            states = [
                each.content["state"] async for each in session.events(job) if each.kind == "state"
            ]
            return [*await asyncio.gather(*windows), states, await session.log(job)]

    one, two = (asyncio.run(asked(place)) for place in (server.url, missions))
    for found, wanted in zip(one, two, strict=True):
        assert_same(found, wanted)
    assert one[-2] == ["waiting", "running", "finished"]
    assert_same(one[0], remote.window(*ONE))


def test_methods_have_the_arguments_and_the_words_of_the_call(remote: Session) -> None:
    found = inspect.signature(remote.items)
    assert list(found.parameters) == ["workspace", "kind", "solution"]
    assert found.return_annotation == "list[dict[str, Any]]"
    assert "mapolas" in (inspect.getdoc(Session.items) or "")
