"""Maplets that contradict their landmarks, the shape or each other; and none that do not."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusion.pipeline.catalog import Catalog, file_digest
from fusion.pipeline.catalog.soundness import (
    Judged,
    Unsound,
    judged,
    judged_after,
    rejected_maplets,
    unsound,
    unsound_maplets,
)
from fusion.workspace import Workspace, new_workspace
from spcola.control import Landmark
from spcola.errors import SpcolaError
from spcola.formats.image_sigmas import write_slope_sigma
from spcola.formats.maplets import read_map, write_maplet
from spcola.formats.shapes import write_obj_mesh
from spcola.formats.solution import read_landmark, write_landmark
from spcola.grids import Maplet, MapletGrid
from spcola.math import lattice
from spcola.shape.icq import IcqShape, icq_directions

RADIUS, GSD, HALF = 50.0, 0.75, 16
# Behind the six bytes that nobody uses, and before the version.
HEADER_BITS = range(48, 568)


def solution(
    root: Path, *, landmarks: bool = True, shape: bool = True, moved_m: float = 0.0
) -> Workspace:
    """Rough maplets of a ball; the landmarks of one in three were `moved_m` since."""
    workspace, rng = new_workspace(root, body="Ball"), np.random.default_rng(1)
    for number, direction in enumerate(lattice(24)):
        name, sigma = f"AA{number:04d}", np.full(3, 0.06)
        grid = MapletGrid.facing(RADIUS * direction, direction, GSD, HALF)
        x = GSD * grid.offsets
        ball = np.sqrt(RADIUS**2 - np.add.outer(x**2, x**2)) - RADIUS
        rough = ball + 0.1 * rng.normal(size=grid.shape)
        maplet = Maplet(name, grid, rough, center_sigma=sigma)
        write_maplet(workspace.maplet_path(name), maplet)
        if landmarks:
            there = replace(grid, center=grid.center + moved_m * (number % 3 == 0))
            write_landmark(workspace.landmark_path(name), Landmark(name, there, sigma))
    if shape:
        ball_shape = IcqShape(RADIUS * icq_directions(24)).mesh()
        write_obj_mesh(root / "SHAPEFILES" / "ball.obj", ball_shape)
    return workspace


@pytest.mark.parametrize("landmarks", [True, False])
@pytest.mark.parametrize("shape", [True, False])
def test_a_right_solution_is_sound(tmp_path: Path, landmarks: bool, shape: bool) -> None:
    assert unsound_maplets(solution(tmp_path, landmarks=landmarks, shape=shape)) == ()


def test_landmarks_that_moved_since_their_maps_were_written_refuse_nothing(tmp_path: Path) -> None:
    """A third of them by some centimetres, as after a new solution of the centres."""
    assert unsound_maplets(solution(tmp_path, moved_m=0.03)) == ()


def test_a_map_that_was_read_and_written_again_is_sound(tmp_path: Path) -> None:
    workspace = solution(tmp_path)
    write_maplet(workspace.maplet_path("AA0003"), workspace.maplet("AA0003"))
    assert unsound_maplets(workspace) == ()


def flipped(workspace: Workspace, name: str, bits: range) -> tuple[int, float]:
    """How many bits of a header pass unseen with an effect, and how far they move a point at most.

    Metres; a change of the centre's sigma by more than 1.3 % counts as a kilometre.
    """
    path = workspace.maplet_path(name)
    good, before = path.read_bytes(), read_map(path).maplet
    passed, moved = 0, 0.0
    for bit in bits:
        content = bytearray(good)
        content[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(content)
        try:
            maplet = read_map(path).maplet
        except SpcolaError:
            continue
        away = float(np.nanmax(np.abs(maplet.points() - before.points())))
        if not np.allclose(maplet.center_sigma, before.center_sigma, rtol=0.013):
            away += 1000.0
        if away > 0.0 and name not in {one.name for one in unsound_maplets(workspace)}:
            passed, moved = passed + 1, max(moved, away)
    path.write_bytes(good)
    return passed, moved


def test_flipped_bits_of_a_header_are_seen(tmp_path: Path) -> None:
    """Some of them: what passes are the last bits of the height quantum."""
    passed, moved = flipped(solution(tmp_path, shape=False), "AA0005", HEADER_BITS[::23])
    assert passed <= 2
    assert moved < 10.0
    there = Workspace.open(tmp_path)
    quantum = range(63 * 8, 67 * 8)
    passed_there, _ = flipped(there, "AA0005", quantum[::9])
    assert passed_there > 0  # without a shape the height of a maplet cannot be checked
    ball_shape = IcqShape(RADIUS * icq_directions(24)).mesh()
    write_obj_mesh(tmp_path / "SHAPEFILES" / "ball.obj", ball_shape)
    passed, moved = flipped(there, "AA0005", quantum[::2])
    assert passed <= 11
    assert moved < 0.5


def test_without_landmarks_axes_and_shape_are_still_checked(tmp_path: Path) -> None:
    workspace = solution(tmp_path, landmarks=False)
    path = workspace.maplet_path("AA0005")
    good = path.read_bytes()
    for byte, bits, words in (
        (30, 64, "from orthonormal"),
        (9, 1, "that of others"),
        (15, 5, "the shape"),
    ):
        content = bytearray(good)
        content[byte] ^= bits
        path.write_bytes(content)
        (found,) = unsound_maplets(workspace)
        assert found.name == "AA0005"
        assert words in found.text
    path.write_bytes(good)


def test_a_maplet_without_lidar_or_landmark_of_another_size_is_sound(tmp_path: Path) -> None:
    """Maplets of several GSDs, some without a landmark, lie in one solution."""
    workspace = solution(tmp_path)
    direction = np.array([0.6, 0.0, 0.8])
    grid = MapletGrid.facing(RADIUS * direction, direction, 0.1234, HALF)
    write_maplet(workspace.maplet_path("ZZ0001"), Maplet("ZZ0001", grid, np.zeros(grid.shape)))
    assert unsound_maplets(workspace) == ()


def without_sigma_of_centre(workspace: Workspace, name: str) -> None:
    maplet = replace(workspace.maplet(name), center_sigma=np.zeros(3))
    write_maplet(workspace.maplet_path(name), maplet)


@pytest.mark.parametrize("count", [1, 12, 24])
def test_maplets_from_images_give_no_sigma_of_their_centre(tmp_path: Path, count: int) -> None:
    """One of a solution, half of them, or all; their landmarks have one still."""
    workspace = solution(tmp_path)
    for name in workspace.maplet_names()[:count]:
        without_sigma_of_centre(workspace, name)
        write_slope_sigma(workspace.maplet_path(name), np.full((2, 2 * HALF, 2 * HALF), 0.03))
    assert unsound_maplets(workspace) == ()


def test_another_maplet_that_lost_the_sigma_of_its_centre_is_named(tmp_path: Path) -> None:
    workspace = solution(tmp_path)
    without_sigma_of_centre(workspace, "AA0005")
    (found,) = unsound_maplets(workspace)
    assert found.name == "AA0005"
    assert "sigma of V is nan, nan, nan m, its landmark has 0.06, 0.06, 0.06" in found.text


def test_a_maplet_that_the_registration_left_out_is_named(tmp_path: Path) -> None:
    workspace = solution(tmp_path, shape=False)
    entries = [
        {"name": "AA0001", "used": True, "reason": ""},
        {"name": "AA0002", "used": False, "reason": "disagrees with the other mapolas"},
        {"name": "AA0003", "used": False, "reason": "covers too little"},
        {"name": "AA0004", "used": False, "reason": "in other words", "cause": "outlier"},
        {"name": "AA0005", "used": False, "reason": "in other words", "cause": "not-covered"},
    ]
    assert rejected_maplets(workspace) == []
    workspace.write_json("registration.json", {"per_mapola": entries})
    (finding,) = rejected_maplets(workspace)
    assert "left out AA0002, AA0004 (disagrees" in finding.text
    assert (finding.code, finding.severity) == ("rejected-maplet", "note")


def test_heights_of_another_place_are_found_by_the_shape(tmp_path: Path) -> None:
    workspace = solution(tmp_path)
    maplet = workspace.maplet("AA0005")
    other = maplet.height + 0.8 * np.sin(0.7 * maplet.grid.offsets)
    write_maplet(workspace.maplet_path("AA0005"), maplet.with_layers(height=other))
    (found,) = unsound_maplets(workspace)
    assert found.name == "AA0005"
    assert "scatter" in found.why


def test_only_files_that_changed_are_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace, read = solution(tmp_path, moved_m=0.03), list[str]()

    def noted(path: Path, **given: Any) -> Any:
        read.append(path.stem)
        return read_map(path, **given)

    monkeypatch.setattr("fusion.pipeline.catalog.maplet_facts.read_map", noted)

    def found() -> tuple[tuple[Unsound, ...], list[str]]:
        """What is unsound, and which maplets were read for that."""
        read.clear()
        with closing(Catalog(workspace)) as catalog:
            now = unsound(workspace, catalog)
        its = list(read)
        assert now == unsound_maplets(workspace)
        return now, its

    every = workspace.maplet_names()
    assert found() == ((), every)
    assert found() == ((), [])
    path, landmark = workspace.maplet_path("AA0005"), workspace.landmark_path("AA0007")
    content = path.read_bytes()
    path.write_bytes(content[:30] + bytes([content[30] ^ 64]) + content[31:])
    assert [one.name for one in found()[0]] == ["AA0005"]
    path.write_bytes(content)
    write_landmark(landmark, replace(read_landmark(landmark), sigma=np.full(3, 0.2)))
    now, its = found()
    assert ([one.name for one in now], its) == (["AA0007"], ["AA0005", "AA0007"])
    landmark.unlink()
    assert found() == ((), ["AA0007"])
    workspace.maplet_path("AA0000").rename(workspace.maplet_path("ZZ0000"))
    # The unit of the shape is checked by the first maplet: with another one all are read again.
    assert sorted(found()[1]) == workspace.maplet_names()
    workspace.maplet_path("AA0010").unlink()
    assert found() == ((), [])
    # Another unit of the shape gives other heights above it.
    toml = workspace.root / "spcola.toml"
    toml.write_text(toml.read_text().replace('shape_unit = "km"', 'shape_unit = "m"'))
    assert sorted(found()[1]) == workspace.maplet_names()
    # What is kept is not trusted if it is damaged.
    kept = workspace.home / "provenance" / ".maplets"
    damaged = bytearray(kept.read_bytes())
    damaged[-3] ^= 1
    kept.write_bytes(damaged)
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert sorted(found()[1]) == workspace.maplet_names()


def test_what_follows_from_a_change_is_known_only_from_the_rows_before(tmp_path: Path) -> None:
    workspace = solution(tmp_path, shape=False)

    def judgement() -> Judged:
        with closing(Catalog(workspace)) as catalog:
            return judged(workspace, catalog)

    before = judgement()
    assert before.kept
    path = workspace.maplet_path("AA0005")
    content = path.read_bytes()
    was = file_digest(path)
    path.write_bytes(content[:9] + bytes([content[9] ^ 1]) + content[10:])
    change = ("MAPFILES/AA0005.MAP", was, file_digest(path))
    wrong = ("MAPFILES/AA0005.MAP", change[2], was)
    assert judged_after(workspace.home, "", [change]) is None
    assert judged_after(workspace.home, before.kept, [wrong]) is None
    # A file that no maplet is judged by changes nothing.
    other = ("LMKFILES/ZZ0001.LMK", was, change[2])
    assert judged_after(workspace.home, before.kept, [other]) == before
    after = judged_after(workspace.home, before.kept, [change])
    assert after is not None
    assert after.unsound == unsound_maplets(workspace) != ()
    assert after == judgement()
    # The rows are now those after it.
    assert judged_after(workspace.home, before.kept, [change]) is None
