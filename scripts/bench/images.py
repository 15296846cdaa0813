"""Time images of a mission on their way into a workspace, and the memory that it takes.

Images of 1024² pixels of 16 bits, half of them FITS and half PDS3 with detached labels. First they
are opened, read, scaled, given thresholds and written, on two threads, from a few different files
with many names. Then, with ``--command``, as many different files come in by ``spcola images`` with
their states from a table, in a process of its own; once more, when all are known by content; and
their triage without a shape. At last a catalogue of 100,000 images is counted and read.

    python scripts/bench/images.py [--count 500] [--pixels 1024] [--different 20] [--command]
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from astropy.io import fits

from fusion.stages.images import count_images
from fusion.stages.images.catalogue import read_catalogue, write_catalogue
from fusion.workspace import Workspace, new_workspace
from spcola.camera.detector import Preparation, prepare_pixels
from spcola.formats.images import open_image, write_image_data

LIMIT_S, LIMIT_MB = 60.0, 1000.0
LABEL = """PDS_VERSION_ID = PDS3
RECORD_TYPE = FIXED_LENGTH
RECORD_BYTES = {width_bytes}
FILE_RECORDS = {size}
^IMAGE = "{name}"
START_TIME = 2019-03-03T08:54:59.913
EXPOSURE_DURATION = 20.0 <ms>
OBJECT = IMAGE
  LINES = {size}
  LINE_SAMPLES = {size}
  SAMPLE_BITS = 16
  SAMPLE_TYPE = MSB_UNSIGNED_INTEGER
END_OBJECT = IMAGE
END
"""


def make_images(folder: Path, count: int, size: int, different: int) -> list[Path]:
    """Write `different` images of a lit ball with noise, and links to them up to `count`."""
    rng = np.random.default_rng(1)
    line, sample = np.indices((size, size)) / size - 0.5
    ball = np.sqrt(np.clip(0.16 - line**2 - sample**2, 0, None))
    first: list[Path] = []
    paths = []
    for number in range(count):
        plain = number % 2 == 1
        path = folder / f"image{number:06d}.{'img' if plain else 'fit'}"
        if number < different:
            brightness = 300 + 8000 * ball * (1 + 0.02 * number) + rng.normal(0, 8, ball.shape)
            pixels = np.clip(brightness, 0, 16383).astype(np.uint16)
            if plain:
                path.write_bytes(pixels.astype(">u2").tobytes())
            else:
                unit = fits.PrimaryHDU(pixels)
                unit.header["DATE-OBS"] = "2019-03-03T08:54:59.913"
                unit.header["EXPTIME"] = 0.02
                unit.writeto(path)
            first.append(path)
        else:
            os.link(first[number % different], path)
        if plain:
            label = LABEL.format(width_bytes=2 * size, size=size, name=path.name)
            path.with_suffix(".lbl").write_text(label)
        paths.append(path.with_suffix(".lbl") if plain else path)
    return paths


def convert(path: Path, folder: Path) -> int:
    """Write an image as .DAT; return the bytes of its pixels."""
    image = open_image(path)
    image.label.mid_exposure()
    prepared = prepare_pixels(image.read(), Preparation())
    write_image_data(folder / f"{path.stem}.DAT", prepared.stored.dn)
    return prepared.stored.dn.nbytes


CAMERA = """[NAC]
focal_length_mm = 125.2
center = [{middle}, {middle}]
k_matrix = [[117.6, 0.0, 0.0], [0.0, 117.6, 0.0]]
size = [{size}, {size}]
"""
POSES = "image,utc,v0x_m,v0y_m,v0z_m,cxx,cxy,cxz,cyx,cyy,cyz,czx,czy,czz,sunx,suny,sunz"


def make_different(folder: Path, count: int, size: int) -> tuple[list[Path], Path, Path]:
    """Write images that all differ in a pixel, a table of their poses, and a camera file."""
    paths = make_images(folder, 2, size, 2)
    fits_bytes, plain_bytes = paths[0].read_bytes(), paths[1].with_suffix(".img").read_bytes()
    lines = [POSES]
    found = []
    for number in range(count):
        plain = number % 2 == 1
        content = bytearray(plain_bytes if plain else fits_bytes)
        place = 2 * size if plain else 2880 + 2 * size
        content[place : place + 4] = (number % 251).to_bytes(2, "big") + (number // 251).to_bytes(
            2, "big"
        )
        path = folder / f"frame{number:06d}.{'img' if plain else 'fit'}"
        path.write_bytes(content)
        if plain:
            label = LABEL.format(width_bytes=2 * size, size=size, name=path.name)
            path.with_suffix(".lbl").write_text(label)
        found.append(path.with_suffix(".lbl") if plain else path)
        lines.append(
            f"frame{number:06d},2019-03-03T08:54:59.923,0,0,{5000 + number},"
            "1,0,0,0,1,0,0,0,1,0,0,-1"
        )
    table, camera = folder / "poses.csv", folder / "camera.toml"
    table.write_text("\n".join(lines) + "\n")
    camera.write_text(CAMERA.format(size=size, middle=size / 2 + 0.5))
    return found, table, camera


def run(*arguments: str | Path) -> tuple[float, float]:
    """Return seconds and largest memory, MB, of a command on two cores."""
    start = time.perf_counter()
    program = [sys.executable, "-m", "fusion.cli", *map(str, arguments)]
    with subprocess.Popen(program, stdout=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(process.returncode)
    return time.perf_counter() - start, usage.ru_maxrss / 1024


def time_command(place: Path, count: int, size: int) -> None:
    """Print seconds and memory of ``spcola images``."""
    source = place / "different"
    source.mkdir()
    paths, table, camera = make_different(source, count, size)
    workspace = new_workspace(place / "ws")
    states = ("--poses", table, "--camera", camera, "--workers", "2")
    print(f"spcola images, {count} different images of {size}², states from a table, two workers")
    for title, more in (
        ("new", (*paths, *states)), ("known", (*paths, *states)), ("triage", ("--report",)),
    ):  # fmt: skip
        seconds, memory = run("images", workspace.root, *more)
        print(
            f"{title:8s}{seconds:7.1f} s {memory:6.0f} MB   "
            f"limits {LIMIT_S:.0f} s, {LIMIT_MB:.0f} MB"
        )


def time_catalogue(place: Path, count: int = 100_000) -> None:
    """Print seconds to count and to read a catalogue of many images."""
    workspace = Workspace(place / "ws")
    first = next(iter(read_catalogue(workspace).values()))
    write_catalogue(workspace, (replace(first, name=f"A{number:09d}") for number in range(count)))
    # `spcola info` counts them.
    for title, call, limit in (
        ("count", count_images, "   limit 1 s"), ("read", read_catalogue, ""),
    ):  # fmt: skip
        start = time.perf_counter()
        call(workspace)
        print(f"{title:8s}{time.perf_counter() - start:7.2f} s for {count} images{limit}")


def main() -> None:
    """Print seconds and memory with their limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--pixels", type=int, default=1024)
    parser.add_argument("--different", type=int, default=20)
    parser.add_argument("--command", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        source, target = Path(place) / "in", Path(place) / "out"
        source.mkdir()
        target.mkdir()
        paths = make_images(source, options.count, options.pixels, options.different)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        start = time.perf_counter()
        with ThreadPoolExecutor(2) as pool:
            size = sum(pool.map(lambda path: convert(path, target), paths))
        seconds = time.perf_counter() - start
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{options.count} images of {options.pixels}², 16 bits, two threads")
    print(f"time    {seconds:8.1f} s    limit {LIMIT_S:.0f} s (for 500 of 1024²)")
    print(f"memory  {memory:8.0f} MB   limit {LIMIT_MB:.0f} MB ({before:.0f} MB before the first)")
    print(f"rate    {size / seconds / 1e6:8.1f} MB/s of pixels")
    if options.command:
        with tempfile.TemporaryDirectory() as place:
            time_command(Path(place), options.count, options.pixels)
            time_catalogue(Path(place))


if __name__ == "__main__":
    main()
