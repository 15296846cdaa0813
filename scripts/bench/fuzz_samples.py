"""A small good file of each format that the program reads, and its reader.

All are made here or by the program's own writers.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from fuzz_cameras import (
    ATTITUDES,
    CATALOGUE,
    POSITIONS,
    colmap,
    isd_text,
    read_camera_file,
    read_kernel,
    read_line_scan,
    write_camera_file,
)
from fuzz_cameras import KERNEL as INSTRUMENT
from fuzz_clouds import las, pcd, ply_cloud, table
from fuzz_images import isis, pds3, read_cube, read_image, write_pds4, write_raster
from fuzz_kernels import (
    KERNEL,
    read_kernels,
    read_spk,
    read_transfer_file,
    transfer_text,
    write_meta_kernel,
    write_spk,
)
from fuzz_rows import (
    COUNT,
    CRAFT,
    POINTS,
    RNG,
    TIMES,
    hayabusa,
    hayabusa2,
    lola,
    lola_binary,
    nlr,
    rows,
    track,
)

from fusion.fusing.maplets import FusedMaplet, Source, read_fused, write_fused
from fusion.products import Provenance
from fusion.products.formats import read_fits_dtm, write_fits_dtm
from fusion.registration.fit import ScanErrorPatterns
from fusion.registration.results import given_registration, mapola_registrations
from fusion.stages.ingest.lidar_files import recorded_source
from fusion.truth import read_truth
from fusion.truth.planted import PlacedCenter, Planted, TrueState, write_truth
from fusion.truth.presets import MissionSettings
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings, load_settings
from fusion.workspace.settings.settings import settings_text
from lidar.adjustment import RigidArcs, ScanAdjustment, ScanErrorSizes
from lidar.formats import open_lidar, recognise
from lidar.formats.mapolas import (
    mapola_names,
    read_adjustment,
    read_mapola,
    write_adjustment,
    write_mapolas,
)
from lidar.formats.missions import write_ola
from lidar.formats.native import ScanFile, scan_summary, write_scan
from lidar.gridding import Mapola
from lidar.scans import Scan
from spcola.camera import Camera, SpcImage
from spcola.control import Landmark
from spcola.formats.cameras import read_colmap_cameras
from spcola.formats.cameras.stars import read_attitudes, read_star_catalogue, read_star_positions
from spcola.formats.images import (
    read_fits_image,
    read_image_data,
    write_fits_image,
    write_image_data,
)
from spcola.formats.maplets import read_maplet, write_maplet
from spcola.formats.shapes import read_shape, recognise_shape, write_icq, write_obj_mesh
from spcola.formats.shapes.ply import write_ply_mesh
from spcola.formats.solution import (
    read_landmark,
    read_list,
    read_nominal,
    read_summary,
    write_landmark,
    write_summary,
)
from spcola.grids import Maplet, MapletGrid
from spcola.shape.icq import IcqShape, icq_directions

Form = Literal["binary", "text", "hdf5", "json"]


GRID = MapletGrid.facing([230.0, 30.0, -50.0], [1.0, 0.1, -0.2], 0.5, 4)


@dataclass(frozen=True)
class Sample:
    """A file format: a function that makes a file in a folder (returns its path), and a reader."""

    make: Callable[[Path], Path]
    read: Callable[[Path], Any]
    form: Form
    threads: bool = False
    """Whether its library starts threads, which a process loses when it forks."""


def _maplet() -> Maplet:
    height = RNG.normal(0, 0.1, GRID.shape)
    return Maplet("AA0001", GRID, height, np.ones(GRID.shape), center_sigma=[0.1, 0.2, 0.3])


def _image() -> SpcImage:
    k_matrix = np.array([[117.6471, -0.25, 1e-5], [0.125, 117.6, -2e-5]])
    camera = Camera(628.9, np.array([8.5, 6.5]), k_matrix, 16, 12, "owen", [1e-5, -3e-7, 2e-6, 0.0])
    pixels = RNG.integers(0, 2**16, size=(12, 16)).astype(np.uint16)
    return SpcImage(
        "P01I02", "2019 JUL 01 03:04:05.678", camera, [1e3 / 3, -2345.678, 9.87e2], np.eye(3),
        np.array([0.48, -0.6, 0.64]), (12, 60000), [0.1, 0.2, 0.3], [1e-6, 2e-6, 3e-7],
        pixels=pixels,
    )  # fmt: skip


def _scan() -> Scan:
    away = POINTS - CRAFT
    distance = np.linalg.norm(away, axis=1)
    return Scan(
        name="s", time=TIMES, range=distance, spacecraft=CRAFT, beam=away / distance[:, None],
        points=POINTS, intensity=np.arange(float(COUNT)), flag=np.zeros(COUNT, dtype=np.int64),
        sigma=np.full(COUNT, 0.1), trajectory="reference", body="Truth",
    )  # fmt: skip


def _written(name: str, write: Callable[[Path], Any]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        write(folder / name)
        return folder / name

    return make


def _bytes(name: str, content: Callable[[], bytes]) -> Callable[[Path], Path]:
    return _written(name, lambda path: path.write_bytes(content()))


def _icq() -> IcqShape:
    return IcqShape(250.0 * icq_directions(3), None, "ball")


def _mapola(folder: Path) -> Path:
    count = RNG.integers(0, 5, GRID.shape)
    made = Mapola(
        "AA0001", GRID, np.where(count > 0, 0.1 * count, np.nan),
        sigma=np.where(count > 0, 0.02, np.nan), count=count,
        spread=np.where(count > 2, 0.03, np.nan), scan_share={"a": 0.25, "b": 0.75},
        center_sigma=[0.1, 0.2, 0.3],
    )  # fmt: skip
    write_mapolas(folder, [made])
    return folder / "mapolas.h5"


def _fused(folder: Path) -> Path:
    source = np.full(GRID.shape, int(Source.BOTH))
    height, sigma = RNG.normal(0, 0.1, GRID.shape), np.full(GRID.shape, 0.02)
    made = FusedMaplet("AA0001", GRID, height, sigma=sigma, count=source, source=source)
    write_fused(folder, [made])
    return next(folder.glob("*.h5"))


def _adjustment(path: Path) -> None:
    count = 4
    half = RNG.normal(size=(6 * count, 6 * count))
    arcs = RigidArcs(POINTS[:count], np.arange(count), np.full(count, -1))
    write_adjustment(
        path,
        ScanAdjustment(
            tuple("abcd"),
            arcs,
            np.zeros((count, 6)),
            half @ half.T * 1e-4,
            ScanErrorSizes(0.05, 0.05, 5e-5, 5e-4, 0.02),
            np.ones(count),
            np.full(count, 99.0),
            1e-4,
        ),
    )


def _dtm(path: Path) -> None:
    write_fits_dtm(path, _maplet(), Provenance("Truth"))


REGISTRATION = {
    "model": "similarity", "scale": 1.001, "scale_sigma": 1e-4, "rotation_deg": [0.1, 0.2, 0.3],
    "translation_m": [1.0, 2.0, 3.0], "covariance": (np.eye(7) * 1e-6).tolist(),
    "parameters": ["tx_m", "ty_m", "tz_m", "rx_rad", "ry_rad", "rz_rad", "scale"],
    "per_scan": [{"scan": "a", "center_m": [1.0, 2, 3], "offset_m": [0, 0, 0.1],
                  "rotation_deg": [0, 0, 0]}],
    "per_mapola": [{"name": "AA0001", "center_m": [230.0, 30.0, -50.0], "used": True,
                    "scan_shift_m": [0, 0, 0], "residual_m": [0, 0, 0.1],
                    "surface_residual_m": [0, 0, 0.1],
                    "position_covariance_m2": np.eye(3).tolist()}],
}  # fmt: skip


def _read_lidar(form: str) -> Callable[[Path], None]:
    """Read as `import` does: with the format named, and as recognised."""

    def read(path: Path) -> None:
        for scan in open_lidar(path, format=form):
            scan.points.sum()
        if recognise(path) != form:
            for scan in open_lidar(path):
                scan.points.sum()

    return read


def _read_native(path: Path) -> None:
    recorded_source(scan_summary(path))
    file = ScanFile(path)
    for scan in file.chunks(5):
        scan.points.sum()
    file.trajectory()


def _read_mapolas(path: Path) -> None:
    for name in mapola_names(path.parent):
        read_mapola(path.parent, name)


def _read_fused(path: Path) -> None:
    read_fused(path.parent, "AA0001")


def _read_adjustment(path: Path) -> None:
    found = read_adjustment(path)
    shares = np.full((3, len(found)), 0.5)
    ScanErrorPatterns.of_adjustment(found, shares, POINTS[:3])
    str(found.suspects), found.sigma.sum()


def _read_pixels(path: Path) -> None:
    image = read_summary(path.parent / "P01I02.SUM")
    read_image_data(path.parent / "P01I02.DAT", image.camera.width, image.camera.height)


def _read_shape(path: Path) -> None:
    recognise_shape(path)
    mesh = read_shape(path)
    _ = (mesh.volume, mesh.mean_radius)


def _read_registration(path: Path) -> None:
    content = Workspace(path.parent).read_json(path.name)
    mapola_registrations(content, str(path))
    given_registration(content, str(path))
    given_registration(content, str(path), inverse=True)


def _with_summary(folder: Path) -> Path:
    image = _image()
    write_summary(folder / "P01I02.SUM", image)
    assert image.pixels is not None
    write_image_data(folder / "P01I02.DAT", image.pixels)
    return folder / "P01I02.DAT"


def _nominal(folder: Path) -> Path:
    lines = ["P01I02", "0.1 0.2 0.3", "1.0 2.0 3.0 SCOBJ", "0.1 0.1 0.1 SIGMA_VSO"]
    lines += ["1 0 0 CX", "0 1 0 CY", "0 0 1 CZ", "1e-3 1e-3 1e-3 SIGMA_PTG", "more"]
    (folder / "P01I02.NOM").write_text("\n".join(lines) + "\n")
    return folder / "P01I02.NOM"


def _truth(path: Path) -> None:
    center = PlacedCenter(
        "AA0001", (1.0, 2.0, 3.0), ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), 0.5, 4, (0.1,) * 3,
        (1.0, 2.0, 3.1),
    )  # fmt: skip
    state = TrueState((1e3, 0.0, 0.0), center.axes)
    write_truth(
        path,
        Planted(
            MissionSettings.tiny(), {}, {"2019-07-01": 1e-4}, {"AA0001": center}, {"P01": state}
        ),
    )


def _lidar(form: str, name: str, content: Callable[[], bytes]) -> Sample:
    binary = name.endswith((".bin", ".dat"))
    return Sample(_bytes(name, content), _read_lidar(form), "binary" if binary else "text")


SOURCE = {"source": "x", "format": "ola", "columns": "{}", "unit": "", "gps_time": 0}
MESH = _icq().mesh()


KINDS: dict[str, Sample] = {
    "map": Sample(
        _written("AA0001.MAP", lambda p: write_maplet(p, _maplet(), sigma_companion=True)),
        read_maplet,
        "binary",
    ),
    "lmk": Sample(
        _written("AA0001.LMK", lambda p: write_landmark(p, Landmark("AA0001", GRID))),
        read_landmark,
        "text",
    ),
    "sum": Sample(lambda f: _with_summary(f).with_suffix(".SUM"), read_summary, "text"),
    "nom": Sample(_nominal, read_nominal, "text"),
    "dat": Sample(_with_summary, _read_pixels, "binary"),
    "list": Sample(
        _bytes("MAPLIST.TXT", lambda: b"AA0001\nAA0002\nAA0003\nEND\n"), read_list, "text"
    ),
    "icq": Sample(_written("a.txt", lambda p: write_icq(p, _icq())), _read_shape, "text"),
    "obj": Sample(_written("a.obj", lambda p: write_obj_mesh(p, MESH)), _read_shape, "text"),
    "ply mesh": Sample(
        _written("a.ply", lambda p: write_ply_mesh(p, MESH, encoding="ascii")), _read_shape, "text"
    ),
    "ply mesh binary": Sample(
        _written("a.ply", lambda p: write_ply_mesh(p, MESH)), _read_shape, "binary"
    ),
    "ply cloud": _lidar("cloud", "a.ply", lambda: ply_cloud("ascii")),
    "ply cloud binary": _lidar("cloud", "a.bin", lambda: ply_cloud("binary_little_endian")),
    "pcd": _lidar("cloud", "a.pcd", lambda: pcd("ascii")),
    "pcd binary": _lidar("cloud", "a.bin", lambda: pcd("binary")),
    "pcd packed": _lidar("cloud", "a.bin", lambda: pcd("binary_compressed")),
    "las": Sample(_written("a.las", las), _read_lidar("las"), "binary"),
    "laz": Sample(_written("a.laz", las), _read_lidar("las"), "binary", threads=True),
    "table": _lidar("table", "a.csv", table),
    "ola": Sample(
        _written("a.dat", lambda p: write_ola(p, [_scan()])), _read_lidar("ola"), "binary"
    ),
    "nlr": _lidar("nlr", "a.tab", rows(nlr, "one header line\nlonE latN and so on\n")),
    "hayabusa": _lidar("hayabusa", "a.tab", rows(hayabusa)),
    "hayabusa2": _lidar("hayabusa2", "a.csv", rows(hayabusa2)),
    "lola": _lidar("lola", "a.csv", rows(lola)),
    "lola binary": _lidar("lola", "a.dat", lola_binary),
    "track": _lidar("track", "a.txt", rows(track)),
    "scan": Sample(
        _written("s.h5", lambda p: write_scan(p, [_scan()], parameters=SOURCE)),
        _read_native,
        "hdf5",
    ),
    "mapolas": Sample(_mapola, _read_mapolas, "hdf5"),
    "fused": Sample(_fused, _read_fused, "hdf5"),
    "adjustment": Sample(_written("adjustment.h5", _adjustment), _read_adjustment, "hdf5"),
    "fits image": Sample(
        _written("a.fits", lambda p: write_fits_image(p, _image())), read_fits_image, "binary"
    ),
    "mission fits": Sample(
        _written("a.fits", lambda p: write_fits_image(p, _image())), read_image, "binary"
    ),
    "pds3": Sample(_bytes("a.img", pds3), read_image, "binary"),
    "pds4": Sample(write_pds4, read_image, "text"),
    "isis": Sample(_bytes("a.cub", isis), read_cube, "binary"),
    "tiff": Sample(_written("a.tif", write_raster), read_image, "binary"),
    "png": Sample(_written("a.png", write_raster), read_image, "binary"),
    "fits dtm": Sample(_written("a.fits", _dtm), read_fits_dtm, "binary"),
    "text kernel": Sample(_bytes("a.tpc", KERNEL.encode), read_kernels, "text"),
    "meta-kernel": Sample(write_meta_kernel, read_kernels, "text"),
    "transfer": Sample(_bytes("a.xsp", transfer_text), read_transfer_file, "text"),
    "spk": Sample(write_spk, read_spk, "binary"),
    "settings": Sample(
        _bytes("spcola.toml", lambda: settings_text(Settings()).encode()), load_settings, "text"
    ),
    "registration": Sample(
        _bytes("registration.json", lambda: json.dumps(REGISTRATION, indent=1).encode()),
        _read_registration,
        "json",
    ),
    "isd": Sample(_bytes("a.isd", isd_text), read_line_scan, "json"),
    "colmap": Sample(_bytes("cameras.bin", colmap), read_colmap_cameras, "binary"),
    "camera file": Sample(_written("a.toml", write_camera_file), read_camera_file, "text"),
    "instrument kernel": Sample(_bytes("a.ti", INSTRUMENT.encode), read_kernel, "text"),
    "star catalogue": Sample(_bytes("a.csv", lambda: CATALOGUE), read_star_catalogue, "text"),
    "star positions": Sample(_bytes("a.csv", lambda: POSITIONS), read_star_positions, "text"),
    "star attitudes": Sample(_bytes("a.csv", lambda: ATTITUDES), read_attitudes, "text"),
    "truth": Sample(_written("truth.json", _truth), read_truth, "json"),
}
