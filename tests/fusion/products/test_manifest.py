"""The manifest: its content, and the digests of the products."""

from __future__ import annotations

import json
from hashlib import sha256

import pytest

from fusion.products import (
    MANIFEST_FILE,
    Provenance,
    describe_product,
    manifest_text,
    versions,
    write_manifest,
)
from spcola.errors import WorkspaceError


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
    manifest = json.loads((release / MANIFEST_FILE).read_text(encoding="utf-8"))
    assert [product["file"] for product in manifest["products"]] == ["a.fits", "b.tif"]
    assert manifest["products"][0]["bytes"] == 60
    assert manifest["products"][0]["made_from"] == {"fused/x": "00"}
    assert manifest["settings"] == {"fuse": {"loss": "huber"}}
    assert set(manifest["versions"]) == {"spcola", "numpy", "scipy", "python"} == set(versions())
    assert manifest["stages"][0]["stage"] == "fuse"
    for product in manifest["products"]:
        assert product["sha256"] == sha256((release / product["file"]).read_bytes()).hexdigest()


def test_provenance_does_not_depend_on_order() -> None:
    one = Provenance("B", {"a": "1", "b": "2"}, {"x": {"p": 1, "q": 2}})
    two = Provenance("B", {"b": "2", "a": "1"}, {"x": {"q": 2, "p": 1}})
    assert one.text() == two.text()
    assert one.settings_digest == two.settings_digest
    assert one.settings_digest != Provenance("B", settings={"x": {"p": 1, "q": 3}}).settings_digest
    assert Provenance("Ğ").text().isascii()


def test_a_product_that_is_gone_is_named(tmp_path) -> None:
    with pytest.raises(WorkspaceError, match="cannot be read"):
        describe_product(tmp_path / "none", kind="", maplet="", made_from={})
