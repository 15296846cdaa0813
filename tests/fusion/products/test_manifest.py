"""The manifest: its content, and that it detects a changed release."""

from __future__ import annotations

import json

import pytest

from fusion.products import (
    MANIFEST_FILE,
    Provenance,
    describe_product,
    manifest_text,
    versions,
    write_manifest,
)
from fusion.products.manifest import check_release, read_manifest
from spcola.errors import FormatError, WorkspaceError


@pytest.fixture
def release(tmp_path, provenance):
    products = []
    for name in ("b.tif", "a.fits"):
        (tmp_path / name).write_bytes(name.encode() * 10)
        products.append(
            describe_product(
                tmp_path / name, kind=name[-3:], maplet="AA0001", made_from={"fused/x": "00"}
            )
        )
    write_manifest(tmp_path, manifest_text(products, provenance, [{"stage": "fuse", "key": "1"}]))
    return tmp_path


def test_manifest_contains_sources_settings_and_versions(release) -> None:
    manifest = read_manifest(release)
    assert [product["file"] for product in manifest["products"]] == ["a.fits", "b.tif"]
    assert manifest["products"][0]["bytes"] == 60
    assert manifest["products"][0]["made_from"] == {"fused/x": "00"}
    assert manifest["settings"] == {"fuse": {"loss": "huber"}}
    assert set(manifest["versions"]) == {"spcola", "numpy", "scipy", "python"} == set(versions())
    assert manifest["stages"][0]["stage"] == "fuse"
    assert check_release(release) == 2


def test_provenance_does_not_depend_on_order() -> None:
    one = Provenance("B", {"a": "1", "b": "2"}, {"x": {"p": 1, "q": 2}})
    two = Provenance("B", {"b": "2", "a": "1"}, {"x": {"q": 2, "p": 1}})
    assert one.text() == two.text()
    assert one.settings_digest == two.settings_digest
    assert one.settings_digest != Provenance("B", settings={"x": {"p": 1, "q": 3}}).settings_digest
    assert Provenance("Ğ").text().isascii()


def test_changed_missing_or_undescribed_product(release) -> None:
    (release / "b.tif").write_bytes(b"c" * 50)
    with pytest.raises(FormatError, match=r"b\.tif: differs from its digest"):
        check_release(release)
    (release / "b.tif").unlink()
    with pytest.raises(FormatError, match=r"b\.tif: is in the manifest but not there"):
        check_release(release)
    manifest = json.loads((release / MANIFEST_FILE).read_text(encoding="utf-8"))
    for key in list(manifest["products"][0]):
        damaged = json.loads(json.dumps(manifest))
        del damaged["products"][0][key]
        (release / MANIFEST_FILE).write_text(json.dumps(damaged), encoding="utf-8")
        with pytest.raises(FormatError, match="product 1: is not described"):
            check_release(release)


def test_no_manifest(tmp_path) -> None:
    with pytest.raises(FormatError, match="cannot be read"):
        read_manifest(tmp_path)
    for text, message in (("{", "is not JSON"), ("[]", "no manifest"), ("{}", "no manifest")):
        (tmp_path / MANIFEST_FILE).write_text(text, encoding="utf-8")
        with pytest.raises(FormatError, match=message if message != "no manifest" else "is not a"):
            read_manifest(tmp_path)
    with pytest.raises(WorkspaceError, match="cannot be read"):
        describe_product(tmp_path / "none", kind="", maplet="", made_from={})
