"""The release stage: whole, repeatable, and true to what the workspace holds."""

from __future__ import annotations

import json
from hashlib import sha256

import numpy as np
import pytest

from fusion.fusing.maplets import FusedMaplet, Source, fused_bigmap, read_fused, write_fused
from fusion.pipeline import Pipeline
from fusion.products import MANIFEST_FILE
from fusion.products.formats import read_fits_dtm, read_geotiff, read_surface, write_fits_dtm
from fusion.stages.release import STAGE
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.errors import WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid


@pytest.fixture
def workspace(tmp_path, make_fused):
    there = Workspace.create(tmp_path / "ws", Settings().with_table("body", name="Bennu"))
    write_fused(there.root / "fused", [make_fused("AA0001", 9, 1), make_fused("AA0002", 9, 2)])
    return there


def release(workspace, *, force=False):
    return Pipeline(workspace, workspace.settings(), [STAGE]).run_stage("release", force=force)


def content(workspace):
    return {p.name: p.read_bytes() for p in (workspace.root / "release").iterdir()}


def checked_manifest(folder):
    """Return the manifest; its digests are those of the files."""
    manifest = json.loads((folder / MANIFEST_FILE).read_text(encoding="utf-8"))
    for entry in manifest["products"]:
        content = (folder / entry["file"]).read_bytes()
        assert (len(content), sha256(content).hexdigest()) == (entry["bytes"], entry["sha256"])
    return manifest


def test_every_product_gives_the_fused_maplet_again(workspace, assert_same) -> None:
    run = release(workspace)
    folder = workspace.root / "release"
    manifest = checked_manifest(folder)
    assert len(manifest["products"]) == run.summary["products"] == 2 * 6 + 1
    assert manifest["body"] == "Bennu"
    seen = set()
    for entry in manifest["products"]:
        path, name = folder / entry["file"], entry["maplet"]
        assert "fused/fused.h5" in entry["made_from"]
        if entry["kind"] in ("map", "sigma", "layers"):
            continue
        wanted = read_fused(workspace.root / "fused", name)
        if entry["kind"] == "fits":
            assert_same(read_fits_dtm(path), wanted)
        elif entry["kind"] == "geotiff":
            np.testing.assert_allclose(read_geotiff(path).height, wanted.height, rtol=1e-7)
        else:
            assert_same(read_surface(path), wanted, everywhere=False)
        seen.add((entry["kind"], name))
    assert len(seen) == 8
    assert_same(read_fused(folder, "AA0001"), read_fused(workspace.root / "fused", "AA0001"))


def test_two_maplets_of_one_place_get_two_names(workspace) -> None:
    release(workspace)
    files = {p.name for p in (workspace.root / "release").glob("*.fits")}
    assert len(files) == 2
    assert any("_dtm2_" in file for file in files)


def test_second_release_is_the_same_to_the_byte(workspace) -> None:
    release(workspace)
    first = content(workspace)
    assert release(workspace).state == "up to date"
    assert release(workspace, force=True).state == "ran"
    assert content(workspace) == first


def test_a_setting_changes_names_and_leaves_nothing_old(workspace) -> None:
    release(workspace)
    there = workspace.root / "release" / "README.txt"
    there.write_text("mine", encoding="utf-8")
    settings = workspace.settings().with_table("release", version=2, products=["fits", "ply"])
    Pipeline(workspace, settings, [STAGE]).run_stage("release")
    names = sorted(content(workspace))
    assert names[0] == "README.txt"
    assert all(n.endswith(("v002.fits", "v002.ply")) for n in names[1:] if n != "manifest.json")
    assert len(checked_manifest(workspace.root / "release")["products"]) == 4


def test_bigmap_gets_its_sources_from_the_maplets(workspace) -> None:
    one = read_fused(workspace.root / "fused", "AA0001")
    bigmap = Maplet(
        "BIGMAP", one.grid, np.nan_to_num(one.height), sigma=np.full(one.grid.shape, 0.1)
    )
    write_maplet(workspace.root / "bigmaps" / "BIGMAP.MAP", bigmap, sigma_companion=True)
    release(workspace)
    entries = checked_manifest(workspace.root / "release")["products"]
    entry = next(e for e in entries if (e["kind"], e["maplet"]) == ("fits", "BIGMAP"))
    assert "bigmaps/BIGMAP.MAP" in entry["made_from"]
    found = read_fits_dtm(workspace.root / "release" / entry["file"])
    two = read_fused(workspace.root / "fused", "AA0002")
    assert (found.count >= one.count).all()
    either = (one.source == Source.BOTH) | (two.source == Source.BOTH)
    assert (found.source[either] == Source.BOTH).all()
    np.testing.assert_allclose(found.sigma, 0.1, rtol=1e-6)


def test_source_of_a_bigmap_point() -> None:
    grid = MapletGrid([0, 0, 99.0], np.eye(3), 1.0, 2)

    def layer(source, count):
        full = np.full(grid.shape, source)
        return FusedMaplet("A", grid, np.zeros(grid.shape), count=count + 0 * full, source=full)

    big = Maplet("B", MapletGrid([0, 0, 99.0], np.eye(3), 1.0, 4), np.zeros((9, 9)))
    image, lidar, filled = layer(1, 0), layer(2, 7), layer(4, 0)
    far = layer(3, 50)
    far = far.with_layers(grid=MapletGrid([0, 0, -99.0], -np.eye(3)[[1, 0, 2]], 1.0, 2))
    assert fused_bigmap(big, [image, filled, far]).source[4, 4] == Source.IMAGE
    assert fused_bigmap(big, [image, lidar]).source[4, 4] == Source.BOTH
    made = fused_bigmap(big, [filled, lidar])
    assert (made.source[4, 4], made.count[4, 4]) == (Source.LIDAR, 7)
    assert (made.source[0, 0], made.count[0, 0]) == (Source.FILLED, 0)


def test_a_failure_leaves_the_old_release(workspace, monkeypatch) -> None:
    release(workspace)
    before = content(workspace)

    def broken(path, maplet, provenance):
        raise WorkspaceError("cannot be written (No space left on device)", path)

    monkeypatch.setattr("fusion.stages.release.SURFACE_WRITERS", {"ply": (".ply", broken)})
    with pytest.raises(WorkspaceError, match="No space left"):
        release(workspace, force=True)
    assert content(workspace) == before


def test_manifest_contains_the_chain_of_stages(workspace) -> None:
    record = {
        "stage": "fuse", "key": "k", "version": "0+1", "settings": {"FuseSettings": {"seed": 7}},
        "inputs": {"scans/a.h5": "11"}, "outputs": {}, "summary": {}, "finished": "2020-01-01",
    }  # fmt: skip
    workspace.write_json("provenance/fuse.json", record)
    release(workspace)
    text = (workspace.root / "release" / "manifest.json").read_text(encoding="utf-8")
    manifest = json.loads(text)
    assert manifest["stages"][0]["inputs"] == {"scans/a.h5": "11"}
    assert manifest["settings"]["FuseSettings"] == {"seed": 7}
    assert "2020-01-01" not in text
    assert str(workspace.root) not in text


def test_nothing_to_release(tmp_path) -> None:
    empty = Workspace.create(tmp_path / "ws", Settings())
    with pytest.raises(WorkspaceError, match="no fused maplets; run: spcola fuse"):
        release(empty)


def test_an_interrupted_release_goes_on_where_it_was(workspace, monkeypatch) -> None:
    """Finished products are not written again; the end is that of an undisturbed release."""
    written, full = [], [True]

    def counted(path, *arguments, **options):
        if written and full:
            full.clear()
            raise WorkspaceError("cannot be written (No space left on device)", path)
        written.append(path.name)
        write_fits_dtm(path, *arguments, **options)

    monkeypatch.setattr("fusion.stages.release.write_fits_dtm", counted)
    with pytest.raises(WorkspaceError, match="No space left"):
        release(workspace)
    release(workspace)
    assert len(written) == len(set(written)) == 2
    interrupted = content(workspace)
    release(workspace, force=True)
    assert len(written) == 4
    assert content(workspace) == interrupted
