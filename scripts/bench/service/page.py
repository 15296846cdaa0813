"""The page's views in a real browser: how long each takes to load, and frames while turning.

    python -m scripts.bench.service.page [WORKSPACE] [--turns 3] [--seconds 3]

A real server process serves WORKSPACE (by default one of the preset `tiny`, made and run here) and
a ball of a million facets. Each view is opened in a browser without a cache, while the server has
answered it before; the first answers of a new server are printed apart. A view is complete when it
is no longer busy and all that it asked for has arrived. Without a GPU frames are drawn in software.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from playwright.sync_api import sync_playwright

from fusion.workspace import new_workspace
from spcola.formats.shapes import write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions

ROOT = Path(__file__).parents[3]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))
from chromium import CHROMIUM, OPTIONS  # noqa: E402
from server_process import ServerProcess  # noqa: E402

LIMIT_S, LIMIT_FRAMES = 1.5, 30.0
SIZE = {"width": 1280, "height": 800}
PATIENCE_S = 120.0
EDGES = 289  # 12 · 289² = 1,002,252 facets
VIEWS = ("overview", "body", "registration", "scale", "solutions", "jobs", "products")
MAPS = ("maplet", "fused", "bigmap")
TURNING = """async (seconds) => {
    const canvas = document.querySelector('canvas[role=application]');
    const key = new KeyboardEvent('keydown', {key: 'ArrowRight', shiftKey: true});
    const gl = canvas.getContext('webgl2');
    const begin = performance.now();
    let frames = 0;
    while (performance.now() - begin < 1000 * seconds) {
        canvas.dispatchEvent(key);
        await new Promise(requestAnimationFrame);
        // Waits until the picture is there.
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        frames += 1;
    }
    return frames / (performance.now() - begin) * 1000;
}"""


@dataclass
class Opened:
    """A page of a fresh browser; `heading` and `complete` are seconds since it was asked for."""

    page: Any
    heading: float = 0.0
    complete: float = 0.0
    waiting: set[Any] = field(default_factory=set)
    arrived: float = 0.0

    def open(self, address: str) -> None:
        """Open a view, and wait until it is complete."""
        self.page.on("request", lambda one: "/events" in one.url or self.waiting.add(one))
        for event in ("requestfinished", "requestfailed"):
            self.page.on(event, self._has_arrived)
        begun = time.perf_counter()
        self.page.goto(address, wait_until="commit")
        self.page.wait_for_selector(".view h1", timeout=1e3 * PATIENCE_S)
        self.heading = time.perf_counter() - begun
        self.page.wait_for_selector(".view:not([aria-busy])", timeout=1e3 * PATIENCE_S)
        shown = time.perf_counter()
        # Tiles and curves are asked for after the view itself is there.
        quiet = time.perf_counter()
        while time.perf_counter() - quiet < 0.2:
            self.page.wait_for_timeout(10)
            if self.waiting:
                quiet = time.perf_counter()
        self.complete = max(shown, self.arrived) - begun

    def _has_arrived(self, request: Any) -> None:
        if request in self.waiting:
            self.waiting.discard(request)
            self.arrived = time.perf_counter()


@contextmanager
def fresh(browser: Any, url: str) -> Iterator[Opened]:
    """A page without anything in its cache."""
    context = browser.new_context(viewport=SIZE, base_url=url)
    try:
        yield Opened(context.new_page())
    finally:
        context.close()


def addresses(url: str, name: str) -> dict[str, str]:
    """Return the main views of a workspace, with a map of each kind there is."""
    found = {"workspaces": "/"} | {view: f"/#/{name}/{view}" for view in VIEWS}
    with httpx.Client(base_url=url, timeout=PATIENCE_S) as client:
        for kind in MAPS:
            path = f"/api/v1/workspaces/{name}/surfaces?kind={kind}&limit=1"
            for surface in client.get(path).json()["surfaces"]:
                found[f"map of a {kind}"] = f"/#/{name}/map/{kind}/{surface['name']}"
    return found


def loading(browser: Any, url: str, name: str, turns: int) -> bool:
    """Print how long each view takes; return whether all are within the limit."""
    good = True
    print(f"{'view':18} {'cold server':>12} {'heading':>9} {'complete':>9}    limit {LIMIT_S} s")
    for view, address in addresses(url, name).items():
        taken = []
        for _ in range(1 + turns):
            with fresh(browser, url) as opened:
                opened.open(address)
                taken.append((opened.heading, opened.complete))
        heading, complete = (statistics.median(each) for each in zip(*taken[1:], strict=True))
        met = complete <= LIMIT_S
        good &= met
        print(
            f"{view:18} {taken[0][1]:10.2f} s {heading:7.2f} s {complete:7.2f} s"
            f"{'' if met else '  MISSED'}",
            flush=True,
        )
    return good


def turning(browser: Any, url: str, name: str, seconds: float) -> None:
    """Print frames per second of a body that turns."""
    with fresh(browser, url) as opened:
        opened.open(f"/#/{name}/body")
        page = opened.page
        page.wait_for_selector(".view[data-frame-ms]", timeout=1e3 * PATIENCE_S)
        root = page.locator(".view")
        whole = 1e3 / float(root.get_attribute("data-frame-ms"))
        frames = page.evaluate(TURNING, seconds)
        counts = root.get_attribute("data-facets"), root.get_attribute("data-coarse-facets")
        drawn = page.evaluate(
            "(() => { const gl = document.createElement('canvas').getContext('webgl2');"
            "const about = gl.getExtension('WEBGL_debug_renderer_info');"
            "return about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : 'unknown'; })()"
        )
    print(f"turning {name}: {drawn}")
    print(f"    all {counts[0]} facets: {whole:.1f} frames a second")
    print(f"    as shown while it turns ({counts[1]} facets where all are too slow): ", end="")
    print(f"{frames:.1f} frames a second (to reach with a GPU: {LIMIT_FRAMES:g})", flush=True)


def million(folder: Path) -> None:
    """Make a workspace that has a shape of a million facets."""
    made = new_workspace(folder, body="Ball")
    directions = icq_directions(EDGES)
    hills = 1.0 + 0.02 * np.sin(9.0 * directions).prod(axis=-1, keepdims=True)
    write_obj_mesh(made.root / "SHAPEFILES" / "ball.obj", IcqShape(250 * hills * directions).mesh())


def tiny(folder: Path, work: Path) -> None:
    """Make and run a workspace of the preset `tiny`."""
    spcola = [sys.executable, "-m", "fusion.cli"]
    mission = work / "mission"
    for command in (
        ["truth", "make", mission, "--preset", "tiny"],
        ["init", folder, "--spc", mission / "spc", "--body", "Truth"],
        ["import", folder, mission / "lidar"],
        ["run", folder],
    ):
        subprocess.run([*spcola, *command], check=True, stdout=subprocess.DEVNULL, cwd=ROOT)


def main() -> int:
    """Print all figures; return 1 if a view misses its limit."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("workspace", nargs="?", type=Path, help="by default a tiny one is made")
    parser.add_argument("--turns", type=int, default=3, help="times each view is opened")
    parser.add_argument("--seconds", type=float, default=3.0, help="of turning")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as started:
        folder = Path(temporary) / "missions"
        folder.mkdir()
        name = options.workspace.resolve().name if options.workspace else "tiny"
        if options.workspace:
            (folder / name).symlink_to(options.workspace.resolve())
        else:
            tiny(folder / name, Path(temporary))
        million(folder / "million")
        browser = started.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        with ServerProcess(folder, "--workers", "0") as server:
            good = loading(browser, server.url, name, options.turns)
            for each in (name, "million"):
                turning(browser, server.url, each, options.seconds)
        browser.close()
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
