"""The job that reads each kind of file that can be uploaded, and the other files that it needs."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fuzz_cameras import ATTITUDES, CATALOGUE, POSITIONS
from fuzz_images import LINES, SAMPLES
from fuzz_kernels import KERNEL
from fuzz_samples import KINDS
from images import CAMERA, POSES

Send = Callable[[str, bytes], str]
"""Uploads a file, and returns its id."""

CLOUDS = ("ply cloud", "ply cloud binary", "pcd", "pcd binary", "pcd packed")
LIDAR = ("las", "ola", "nlr", "hayabusa", "hayabusa2", "lola", "lola binary", "track")
IMAGES = ("mission fits", "fits image", "pds3", "isis", "tiff", "png")
CONVERTED = ("camera file", "colmap", "isd")
KERNELS = ("text kernel", "meta-kernel", "transfer", "spk")
SPC = ("map", "lmk", "sum", "nom", "dat", "list")
SHAPES = ("icq", "obj", "ply mesh", "ply mesh binary")
STARS = {"star catalogue": "catalogue", "star positions": "stars", "star attitudes": "attitudes"}
POLE = b"""
\\begindata
BODY0_POLE_RA = (10 0 0)
BODY0_POLE_DEC = (20 0 0)
BODY0_PM = (30 100 0)
BODY0_RADII = (1 1 1)
"""
POSE = "0,0,5000,1,0,0,0,1,0,0,0,1,0,0,-1"
EXPOSURES = b"image,utc\nN1,2019-03-03T10:59:40\n"
TABLE_COLUMNS = {
    **{name: f"{name}_m [m]" for name in ("x", "y", "z")},
    "range": "range_m [m]",
    "time": "utc [utc]",
}


@dataclass(frozen=True)
class Reading:
    """How the service comes to read a file.

    Attributes
    ----------
    job : str
        Kind of the job.
    parameters : callable
        Takes what uploads further files, the name of the file and its id.
    fresh : bool
        Whether the job makes the workspace.
    """

    job: str
    parameters: Callable[[Send, str, str], Mapping[str, Any]]
    fresh: bool = False


def _plain(**more: Any) -> Callable[[Send, str, str], Mapping[str, Any]]:
    return lambda _, __, upload: {"uploads": [upload], **more}


def _camera(send: Send) -> str:
    text = CAMERA.format(size=0, middle=8.5).replace("[0, 0]", f"[{SAMPLES}, {LINES}]")
    return send("nac.toml", text.encode())


def _posed(send: Send, name: str, upload: str) -> dict[str, Any]:
    """Return the parameters of an image whose state is in a table."""
    table = f"{POSES}\n{Path(name).stem},2019-03-03T08:54:59.9,{POSE}\n".encode()
    size = [SAMPLES, LINES] if name.endswith(".DAT") else None
    return {
        "uploads": [upload], "camera": _camera(send), "poses": send("poses.csv", table),
        "letter": "A", "size": size,
    }  # fmt: skip


def _posing(part: str) -> Callable[[Send, str, str], dict[str, Any]]:
    """Return the parameters of an image whose camera or rotation is the input."""

    def given(send: Send, _: str, upload: str) -> dict[str, Any]:
        image = send("Q1.png", GOOD["png"])
        return _posed(send, "Q1.png", image) | {part: upload}

    return given


def _labelled(send: Send, _: str, upload: str) -> dict[str, Any]:
    """Return the parameters of a PDS4 label, whose pixels are a file of their own."""
    return {"uploads": [upload, send("a.img", GOOD["pds4 pixels"])], "letter": "A"}


def _spice(send: Send, name: str, upload: str) -> dict[str, Any]:
    """Return the parameters of states by kernels."""
    kernels = [upload] if name == "a.tpc" else [upload, send("a.tpc", KERNEL.encode())]
    return {
        "table": send("exposures.csv", EXPOSURES), "kernel": kernels, "frame": "J2000",
        "camera": _camera(send), "spacecraft": "-64", "body": 2101955,
    }  # fmt: skip


def _stars(part: str) -> Callable[[Send, str, str], dict[str, Any]]:
    def given(send: Send, _: str, upload: str) -> dict[str, Any]:
        tables = {"catalogue": CATALOGUE, "stars": POSITIONS, "attitudes": ATTITUDES}
        files = {name: send(f"{name}.csv", text) for name, text in tables.items()}
        return {"camera": _camera(send), "out": "nac.toml", **files, part: upload}

    return given


def _shape(_: Send, __: str, upload: str) -> dict[str, Any]:
    return {"body": "Ball", "shape": upload, "shape_unit": "m"}


READINGS: dict[str, Reading] = {
    "scan": Reading("import", _plain()),
    **{name: Reading("import", _plain(format=name.partition(" ")[0])) for name in LIDAR},
    "laz": Reading("import", _plain(format="las")),
    "table": Reading("import", _plain(format="table", columns=TABLE_COLUMNS)),
    **{name: Reading("import", _plain(format="cloud", unit="m")) for name in CLOUDS},
    **{name: Reading("images", _plain(letter="A")) for name in IMAGES},
    "tiff": Reading("images", _posed),
    "png": Reading("images", _posed),
    "pds4": Reading("images", _labelled),
    "dat": Reading("images", _posed),
    "camera of images": Reading("images", _posing("camera")),
    "pck of images": Reading("images", _posing("pck")),
    **{name: Reading("init", _plain(body="Ball"), fresh=True) for name in SPC if name != "dat"},
    **{name: Reading("init", _shape, fresh=True) for name in SHAPES},
    **{name: Reading("sumfiles", _spice) for name in KERNELS},
    **{name: Reading("camera-convert", _plain(out="cam.toml")) for name in CONVERTED},
    "instrument kernel": Reading("camera-convert", _plain(out="cam.toml", number=-99)),
    **{name: Reading("camera-calibrate", _stars(part)) for name, part in STARS.items()},
    "truth": Reading("truth-assess", lambda _, __, upload: {"truth": upload}),
}
SAMPLES_OF = {"camera of images": "camera file", "pck of images": "text kernel"}
"""Whose good file is that of another kind."""
GOOD: dict[str, bytes] = {}
"""Contents of the good files, of `make_good`."""
NAMES: dict[str, str] = {}
"""Names of the good files."""


def make_good(folder: Path) -> None:
    """Make the good file of each kind, or read those that are there."""
    for kind in READINGS:
        place = folder / kind.replace(" ", "-")
        if not place.is_dir():
            made = place.with_suffix(".new")
            shutil.rmtree(made, ignore_errors=True)
            made.mkdir(parents=True)
            path = KINDS[SAMPLES_OF.get(kind, kind)].make(made)
            (made / "name").write_text(path.name)
            made.rename(place)
        NAMES[kind] = (place / "name").read_text()
        GOOD[kind] = (place / NAMES[kind]).read_bytes()
    GOOD["pck of images"] += POLE
    GOOD["pds4 pixels"] = (folder / "pds4" / "a.img").read_bytes()
