"""Photoclinometry on real images: NavCam frames of 67P, Apollo 15, Vesta, and landmarks of 67P.

All of it by the real commands, from the shared data into a folder: images come in, states are
fitted to the shape (`spc register`), maplets are tiled over it and solved (`spc lithos`), without
every tenth frame. For these the brightness that the maplets predict is compared with that of their
start, at the states that they get against the same shape.

    python scripts/bench/photoclinometry_real.py --work DIR [--data ../shared/data]
        [--parts 67p apollo15 vesta landmarks] [--workers 1] [--maplets N] [--gammas 1 1.5 2 2.5]
        [--every 1]

`--gammas` imports every fourth frame of 67P with several encodings of the brightness, and prints
which one fits. `--maplets` solves so many maplets of each body only, `--every 4` takes every fourth
frame of 67P, for a trial. Workspaces and the page of the best and worst go into `--work`. All takes
a quarter of an hour on one core.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from real.comet import comet, encodings, landmarks
from real.moon import moon
from real.run import Run
from real.vesta import vesta

PARTS = {"67p": comet, "apollo15": moon, "vesta": vesta, "landmarks": landmarks}


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--maplets", type=int, default=0)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--gammas", nargs="+", type=float, default=[])
    asked = parser.parse_args()
    asked.work.mkdir(parents=True, exist_ok=True)
    run = Run(asked.data.resolve(), asked.work, asked.workers, asked.maplets, asked.every)
    if asked.gammas:
        encodings(run, asked.gammas)
    for part in asked.parts:
        PARTS[part](run)


if __name__ == "__main__":
    main()
