"""A served workspace, and Chromium to look at it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from chromium import CHROMIUM, OPTIONS
from playwright.sync_api import sync_playwright
from server_process import ServerProcess

from fusion.service.page import is_built


@pytest.fixture(scope="module")
def folder(by_command: tuple[Path, dict], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the workspace `ball`, whose mapolas are made."""
    root = tmp_path_factory.mktemp("page")
    shutil.copytree(by_command[0], root / "ball")
    return root


@pytest.fixture(scope="module")
def served(folder: Path, request: pytest.FixtureRequest) -> Iterator[str]:
    """The URL of a running service; it has a worker where the module sets `HAS_JOBS`."""
    workers = "1" if getattr(request.module, "HAS_JOBS", False) else "0"
    with ServerProcess(folder, "--workers", workers) as server:
        yield server.url


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A browser; tests are skipped where there is none, or where the page is not built.

    Its loop runs until the end of the module: other tests need loops of their own.
    """
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    if not is_built():
        pytest.skip("the page is not built: scripts/page")
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield browser
        browser.close()


@pytest.fixture
def page(chromium: Any, served: str) -> Iterator[Any]:
    """A page in a context of its own, in which nothing fails and nothing leaves the service."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, base_url=served)
    opened = context.new_page()
    faults: list[str] = []
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on("console", lambda line: _is_fault(line) and faults.append(line.text))
    opened.on("response", lambda answer: answer.status >= 500 and faults.append(answer.url))
    opened.on("request", lambda asked: _foreign(asked.url, served) and faults.append(asked.url))
    yield opened
    context.close()
    assert not faults


def _is_fault(line: Any) -> bool:
    # The browser itself notes each request that is refused or broken: tests look at what is shown.
    return line.type == "error" and not line.text.startswith("Failed to load resource")


def _foreign(url: str, served: str) -> bool:
    return not url.startswith((served, "blob:", "data:", "about:"))
