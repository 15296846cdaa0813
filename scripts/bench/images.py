"""Time the conversion of images of a mission to .DAT, and the memory that it takes.

Images of 1024² pixels of 16 bits, half of them FITS and half PDS3 with detached labels, are
opened, read, scaled, given thresholds and written, on two threads. Everything is written and
flushed to the disk; only a few different files are made, which have many names.

    python scripts/bench/images.py [--count 500] [--pixels 1024] [--different 20]
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from astropy.io import fits

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


def main() -> None:
    """Print seconds and memory beside their limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--pixels", type=int, default=1024)
    parser.add_argument("--different", type=int, default=20)
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


if __name__ == "__main__":
    main()
