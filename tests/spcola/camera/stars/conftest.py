"""Synthetic star fields with planted camera, attitudes, noise and false stars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.projection import project_vectors
from spcola.camera.stars import StarCatalogue, StarPositions

SIGMA_PX = 0.1


@dataclass(frozen=True)
class Sky:
    """A catalogue of stars about one direction, and the frames that a camera takes of it."""

    catalogue: StarCatalogue
    random: np.random.Generator

    def attitude(self) -> FloatArray:
        """An attitude within a degree of the middle of the stars, with any twist."""
        tilt = Rotation.from_rotvec([*self.random.normal(scale=0.01, size=2), 0.0])
        twist = Rotation.from_rotvec([0.0, 0.0, self.random.uniform(0, 2 * np.pi)])
        return (twist * tilt).as_matrix()

    def frame(
        self, camera: Camera, axes: FloatArray, *, false: int = 5, missed: float = 0.2
    ) -> tuple[StarPositions, FloatArray]:
        """Measured stars of one image, and the place in the catalogue of each (−1: false)."""
        pixel, line = project_vectors(camera, self.catalogue.directions @ axes.T)
        seen = (pixel > 3) & (pixel < camera.width - 2) & (line > 3) & (line < camera.height - 2)
        places = np.flatnonzero(seen & (self.random.uniform(size=len(seen)) > missed))
        spots = np.column_stack([pixel, line])[places]
        spots = spots + SIGMA_PX * self.random.normal(size=spots.shape)
        others = self.random.uniform(1, [camera.width, camera.height], (false, 2))
        spots = np.concatenate([spots, others])
        covariance = np.broadcast_to(SIGMA_PX**2 * np.eye(2), (len(spots), 2, 2))
        stars = StarPositions(spots[:, 0], spots[:, 1], covariance, np.full(len(spots), np.nan))
        return stars, np.concatenate([places, np.full(false, -1)])


@pytest.fixture
def sky():
    """Maker of a sky: by seed, 400 stars in 4.5° about the z axis."""

    def make(seed: int, count: int = 400, radius: float = 0.08) -> Sky:
        random = np.random.default_rng(seed)
        off = radius * np.sqrt(random.uniform(size=count))
        angle = random.uniform(0, 2 * np.pi, count)
        tangent = [off * np.cos(angle), off * np.sin(angle), np.ones(count)]
        directions = np.stack(tangent, axis=-1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return Sky(StarCatalogue(directions, random.uniform(2, 9, count)), random)

    return make


@pytest.fixture
def lens() -> Camera:
    """A camera of MapCam's size: 4° on 1024 pixels of 8.5 µm."""
    return Camera(
        125.2, [512.5, 512.5], [[117.647, 0.02, 0], [0.0, -117.7, 0]], 1024, 1024, "owen",
        [2e-5, -3e-7, 3e-5, -2e-5],
    )  # fmt: skip
