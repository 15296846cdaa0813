"""How the files of the page are served, and what stands there when it is not built."""

from __future__ import annotations

from pathlib import Path

import pytest
from asgi_client import AsgiClient

from fusion.service.api.routes import page


def test_a_page_that_is_not_built_is_named(
    client: AsgiClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "is_built", lambda: False)
    answer = client.get("/")
    assert answer.status_code == 503
    assert "run <code>scripts/page</code>" in answer.text


def test_hashed_files_are_kept_and_the_index_is_asked_for(
    client: AsgiClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "index.html").write_text("<!doctype html>")
    (tmp_path / "main-0123ABCD.js").write_text("1;")
    monkeypatch.setattr(page, "STATIC", tmp_path)
    monkeypatch.setattr(page, "is_built", lambda: True)
    script, index = client.get("/static/main-0123ABCD.js"), client.get("/")
    assert script.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert script.headers["content-type"] == "text/javascript; charset=utf-8"
    assert index.headers["cache-control"] == "no-cache"
    again = client.get("/", headers={"If-None-Match": index.headers["etag"]})
    assert again.status_code == 304
    for answer in (script, index):
        policy = answer.headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "unsafe" not in policy
