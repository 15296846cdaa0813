"""Images of stars by a camera that is known, with the tables of a calibration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from PIL import Image
from scipy.special import erf

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.instrument import Instrument
from spcola.camera.projection import project_vectors
from spcola.formats.cameras import read_cameras, write_cameras
from spcola.formats.cameras.stars.tables import _axes
from spcola.formats.images import write_image_data

TRUE = Camera(
    125.2, [256.5, 256.5], [[60.0, 0.01, 0], [0, -60.05, 0]], 512, 512, "owen", [2e-5, 0, 0, 0]
)
NOMINAL = replace(TRUE, focal_length_mm=125.25, distortion=np.zeros(4),
                  k_matrix=[[60.0, 0, 0], [0, -60.0, 0]])  # fmt: skip
VELOCITY = np.array([12.0, -20.0, 5.0])
FILES = {"S4": "S4.DAT", "S5": "S5.png"}


class Cruise:
    """Six images of one field, with their tables."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.random = np.random.default_rng(11)
        ra, dec = self.random.uniform(80, 90, 900), self.random.uniform(15, 24, 900)
        self.write("sky.csv", "RA (deg),Dec (deg),Vmag", zip(ra, dec, 5.0 + 0 * ra, strict=True))
        a, d = np.radians([ra, dec])
        sky = np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)], axis=-1)
        # aberration to first order is enough here: (v/c)² is 1e-8
        self.sky = sky + VELOCITY / 299792.458
        self.sky /= np.linalg.norm(self.sky, axis=1, keepdims=True)
        write_cameras(folder / "nominal.toml", [Instrument("NAC", NOMINAL)])
        self.pointing = [
            (f"S{n}", 85 + self.random.uniform(-1, 1), 20 + self.random.uniform(-1, 1), 60.0 * n)
            for n in range(6)
        ]
        self.spots = {row[0]: self._spots(*row[1:]) for row in self.pointing}

    def write(self, name: str, head: str, rows) -> Path:
        path = self.folder / name
        path.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n")
        return path

    def _spots(self, ra: float, dec: float, twist: float) -> FloatArray:
        spots = np.column_stack(
            project_vectors(TRUE, self.sky @ _axes(*np.radians([ra, dec, twist])).T)
        )
        return spots[np.all((spots > 5) & (spots < 508), axis=1)]

    def attitudes(self, *, files: bool = False) -> Path:
        """Approximate attitudes: 0.05° off."""
        rows = [
            (name, *(np.add([ra, dec, twist], self.random.normal(scale=0.05, size=3))), *VELOCITY,
             *([FILES.get(name, f"{name}.fits")] if files else []))
            for name, ra, dec, twist in self.pointing
        ]  # fmt: skip
        return self.write("att.csv", "image,ra,dec,twist,vx,vy,vz" + ",file" * files, rows)

    def positions(self) -> Path:
        rows = [
            (name, *(spot + self.random.normal(scale=0.05, size=2)), 0.05)
            for name, spots in self.spots.items()
            for spot in [*spots, *self.random.uniform(1, 512, (3, 2))]
        ]
        return self.write("stars.csv", "image,pixel,line,sigma", rows)

    def images(self) -> None:
        edge = np.arange(513) + 0.5
        for name, spots in self.spots.items():
            image = 50.0 + 2.0 * self.random.normal(size=(512, 512))
            for pixel, line in spots:
                down, across = (np.diff(0.5 * erf((edge - at) / 1.13)) for at in (line, pixel))
                image += 900.0 * np.outer(down, across)
            dn = np.clip(image, 0, 65535).round().astype(np.uint16)
            if name == "S4":
                write_image_data(self.folder / "S4.DAT", dn)
            elif name == "S5":
                Image.fromarray(dn).save(self.folder / "S5.png")
            else:
                fits.PrimaryHDU(image.astype(np.float32)).writeto(self.folder / f"{name}.fits")


def check_calibration(content: dict, out: Path, *, limit: float = 4.0) -> None:
    """Planted values within their sigmas, and in the camera file."""
    planted = {"focal_length_mm": 125.2, "k_xy": 0.01, "k_yy": -60.05, "distortion[0]": 2e-5}
    found = {one["name"]: one for one in content["parameters"]}
    for name, value in planted.items():
        assert abs(found[name]["value"] - value) < limit * found[name]["sigma"], name
    camera = read_cameras(out)["NAC"].camera
    assert camera.focal_length_mm == found["focal_length_mm"]["value"]
    assert camera.k_matrix[0, 0] == 60.0
    assert content["unit_variance"] == pytest.approx(1.0, abs=0.15)
