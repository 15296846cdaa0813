"""Where the work on one set of real images is done, and its commands."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.scene import Exposures
from fusion.workspace import Workspace
from real.steps import UNSOLVED, print_outcomes
from spcola.camera import SpcImage


@dataclass(frozen=True)
class Solved:
    """A workspace before and after its maplets were solved.

    Parameters
    ----------
    content : dict
        Of ``spc lithos --json``.
    start, after : Workspace
    """

    content: dict[str, Any]
    start: Workspace
    after: Workspace

    @property
    def names(self) -> list[str]:
        """The maplets that do not keep their start."""
        maplets = self.content["maplets"]
        return [name for name, one in maplets.items() if one["outcome"] not in UNSOLVED]

    @property
    def photometry(self) -> str:
        """The photometric function of the solution, as its setting."""
        return str(self.content["options"]["photometry"])


@dataclass(frozen=True)
class Run:
    """Where the data are and the work is done.

    Parameters
    ----------
    data, work : Path
    workers : int
    maplets : int
        Most maplets that are solved; 0 for all.
    every : int
        Every n-th frame of 67P is used; 1 for all.
    """

    data: Path
    work: Path
    workers: int
    maplets: int
    every: int

    def spcola(self, *words: object, parallel: bool = True) -> dict[str, Any]:
        """Run a command and return its object."""
        more = ["--workers", str(self.workers)] if parallel else []
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "fusion.cli", *map(str, words), *more, "--json"],
            check=False, capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            sys.exit(done.stderr.splitlines()[-1])
        shown = " ".join(str(word) for word in words[:2])
        print(f"  {shown:24s}{time.perf_counter() - start:7.1f} s", flush=True)
        content: dict[str, Any] = json.loads(done.stdout)
        return content

    def use(self, root: Path, solution: str) -> None:
        """Use a solution of a workspace from then on."""
        self.spcola("solution", "use", root, solution, parallel=False)

    def register(self, root: Path) -> dict[str, Any]:
        """Fit the states of images to the shape: the solution `registered`."""
        return self.spcola("spc", "register", root, "--as", "registered")

    def tile(self, root: Path, gsd: float, within: str = "") -> dict[str, Any]:
        """Tile maplets of a GSD (m) from the shape, over all of it or a place: `tiles`."""
        place = ["--within", within] if within else []
        return self.spcola(
            "spc", "tile", root, "--gsd", gsd, "--half-size", 24, *place, "--from", "shape",
            "--as", "tiles",
        )  # fmt: skip

    def solve(self, root: Path, *words: object) -> Solved:
        """Solve the maplets in use, as many as are asked for: the solution `images`."""
        start = Workspace.open(root)
        names = [name for name in start.maplet_names() if start.landmark(name).pictures]
        step = max(1, len(names) // self.maplets) if self.maplets else 1
        only = [word for name in names[::step] for word in ("--only", name)]
        found = self.spcola("spc", "lithos", root, *words, *only, "--as", "images")
        print_outcomes(found)
        return Solved(found, start, Workspace.open(root, "images"))


def exposed(workspace: Workspace) -> list[SpcImage]:
    """Return the images of a workspace with their pixels."""
    exposures = Exposures(workspace)
    return [exposures(image) for image in workspace.images()]
