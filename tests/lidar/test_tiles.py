"""Returns sorted into tiles on disk: complete, bounded, whole or not there."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from lidar.gridding import GriddingOptions, grid_returns
from lidar.returns import Returns
from lidar.scan import Scan
from lidar.tiles import TileReader, TileWriter
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.maplet import MapletGrid

RADIUS = 12.0


def sphere(rng, count):
    points = rng.normal(size=(count, 3))
    return 50.0 * points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.fixture
def mission():
    """Centres on a sphere, and two scans in three chunks that cover it."""
    rng = np.random.default_rng(1)
    centers = sphere(rng, 300)
    chunks = [
        Scan.of_points(name, sphere(rng, count), sigma=rng.uniform(0.01, 0.02, count))
        for name, count in (("first", 4000), ("second", 3000), ("first", 2500))
    ]
    return centers, chunks


def written(path, mission, radius=RADIUS):
    centers, chunks = mission
    with TileWriter(path, centers, radius) as writer:
        for chunk in chunks:
            writer.add(chunk)
    return path


def kept(points, centers):
    """Count the points that lie within RADIUS of some centre."""
    distance = np.linalg.norm(points[:, None] - centers, axis=2)
    return int((distance.min(axis=1) <= RADIUS).sum())


def as_rows(points, sigma, names):
    return sorted(zip(*points.T.tolist(), sigma.tolist(), names, strict=True))


def test_returns_near_a_centre_are_all_there(tmp_path, mission):
    centers, chunks = mission
    points = np.concatenate([c.points for c in chunks])
    sigma = np.concatenate([c.sigma for c in chunks])
    names = np.concatenate([[c.name] * len(c) for c in chunks])
    with TileReader(written(tmp_path / "tiles.h5", mission)) as reader:
        assert len(reader) == kept(points, centers)
        for center in centers[:20]:
            near = np.linalg.norm(points - center, axis=1) <= 9.0
            got = reader.returns_near(center, 9.0)
            got_names = [got.scan_names[i] for i in got.scan]
            assert near.sum() > 10
            assert as_rows(got.points, got.sigma, got_names) == as_rows(
                points[near], sigma[near], names[near].tolist()
            )


def test_the_order_of_chunks_changes_no_mapola(tmp_path, mission):
    centers, chunks = mission
    one = written(tmp_path / "one.h5", (centers, chunks))
    shuffled = [c.select(np.random.default_rng(2).permutation(len(c))) for c in chunks[::-1]]
    other = written(tmp_path / "other.h5", (centers, shuffled))
    grid = MapletGrid.facing(centers[0], centers[0], 0.5, 8)
    radius = GriddingOptions().neighbourhood(grid)
    results = []
    for path in (one, other):
        with TileReader(path) as reader:
            results.append(grid_returns("A", grid, reader.returns_near(centers[0], radius)))
    whole = grid_returns("A", grid, Returns.of_scans(chunks))
    assert results[0].report == results[1].report
    for result in results:
        assert np.array_equal(result.mapola.height, whole.mapola.height, equal_nan=True)
        assert np.array_equal(result.mapola.sigma, whole.mapola.sigma, equal_nan=True)
        assert result.mapola.scan_share == whole.mapola.scan_share


def test_returns_far_from_every_centre_are_left_out_and_counted(tmp_path, mission):
    centers, chunks = mission
    far = Scan.of_points("far", np.full((7, 3), 900.0))
    with TileWriter(tmp_path / "tiles.h5", centers, RADIUS) as writer:
        writer.add(chunks[0])
        writer.add(far)
        assert writer.left_out == 7 + len(chunks[0]) - kept(chunks[0].points, centers)
    with TileReader(tmp_path / "tiles.h5") as reader:
        assert len(reader) == kept(chunks[0].points, centers)
        assert reader.scan_names == ("first", "far")
        assert reader.body == "body-fixed"


def test_what_was_not_kept_whole_is_refused(tmp_path, mission):
    centers, _ = mission
    with TileReader(written(tmp_path / "tiles.h5", mission)) as reader:
        reader.returns_near(centers[3], RADIUS)
        with pytest.raises(InvalidValueError, match="were not kept whole"):
            reader.returns_near(centers[3], 1.01 * RADIUS)
        with pytest.raises(InvalidValueError, match="larger radius"):
            reader.returns_near(2 * centers[3], 5.0)


def test_an_empty_mission_has_no_returns(tmp_path, mission):
    centers, chunks = mission
    none = [chunks[0].select(slice(0, 0))]
    with TileReader(written(tmp_path / "tiles.h5", (centers, none))) as reader:
        assert len(reader.returns_near(centers[0], 3.0)) == 0


def test_an_interrupted_writing_leaves_the_old_file(tmp_path, mission):
    centers, chunks = mission
    path = written(tmp_path / "tiles.h5", mission)
    before = path.read_bytes()

    def interrupted():
        with TileWriter(path, centers, RADIUS) as writer:
            writer.add(chunks[0])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["tiles.h5"]


def test_frames_do_not_mix(tmp_path, mission):
    centers, chunks = mission
    moon = Scan.of_points("moon", np.zeros((2, 3)), body="moon")

    def mixed():
        with TileWriter(tmp_path / "tiles.h5", centers, RADIUS) as writer:
            writer.add(chunks[0])
            writer.add(moon)

    with pytest.raises(InvalidValueError, match="moon: lies in moon, the others in body-fixed"):
        mixed()
    assert list(tmp_path.iterdir()) == []


def test_bad_arguments_are_refused(tmp_path):
    with pytest.raises(InvalidValueError, match="no centre"):
        TileWriter(tmp_path / "t.h5", np.empty((0, 3)), 1.0)
    with pytest.raises(InvalidValueError, match="radius: must be positive"):
        TileWriter(tmp_path / "t.h5", np.zeros((1, 3)), 0.0)
    with (
        pytest.raises(WorkspaceError, match="create the folder first"),
        TileWriter(tmp_path / "absent" / "t.h5", np.zeros((1, 3)), 1.0),
    ):
        pass


def test_other_files_are_refused(tmp_path, mission):
    with pytest.raises(WorkspaceError, match="cannot be opened as HDF5"):
        TileReader(tmp_path / "absent.h5")
    (tmp_path / "text.h5").write_text("no HDF5")
    with pytest.raises(WorkspaceError, match="cannot be opened as HDF5"):
        TileReader(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(FormatError, match="is not 'spcola tiles 1'"):
        TileReader(tmp_path / "other.h5")
    path = written(tmp_path / "tiles.h5", mission)
    with h5py.File(path, "r+") as file:
        file["returns"].resize((10,))
    with pytest.raises(FormatError, match="index points past the last return"):
        TileReader(path)
