"""Draws the pictures of the page for the documentation: scripts/page --screenshots DIR."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "_static"
SIZE = {"width": 1280, "height": 800}
VIEWS = {
    **{name: name for name in ("overview", "body", "map", "registration", "scale")},
    "form": "jobs/new/images",
}
"""Names of the pictures, and the addresses of their views."""


def main(folder: Path) -> None:
    """Serve a folder of workspaces, and draw views of the first one."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        raise SystemExit("error: no Chromium is installed; apt-get install chromium")
    command = [sys.executable, "-m", "fusion.cli", "serve", str(folder), "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            draw(browser, _url(server))
        finally:
            server.terminate()


def draw(browser: str, url: str) -> None:
    """Draw all pictures."""
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=browser, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = started.new_page(viewport=SIZE, base_url=url)
        page.goto("/")
        name = page.locator("tbody a").first.text_content()
        for view, address in VIEWS.items():
            page.goto("about:blank")
            page.goto(f"/#/{name}/{address}")
            page.wait_for_selector(".view:not([aria-busy])")
            page.wait_for_timeout(1500)  # tiles and curves come after the view itself
            file = PICTURES / f"page_{view}.webp"
            with Image.open(io.BytesIO(page.screenshot())) as shot:
                shot.convert("RGB").save(file, quality=88, method=6)
            print(f"docs/_static/page_{view}.webp")


def _url(server: subprocess.Popen[str]) -> str:
    printed = ""
    assert server.stdout is not None
    while not printed.endswith("}\n"):
        line = server.stdout.readline()
        if not line:
            raise SystemExit("error: the service did not start; its message stands above")
        printed += line
    return str(json.loads(printed)["url"])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
