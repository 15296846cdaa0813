"""Photographs of waves on a plane, made without the code under test."""

from __future__ import annotations

import numpy as np

from spcola.camera import Camera, SpcImage
from spcola.grids import MapletGrid
from spcola.photometry.functions import lambert

# Wave vectors (rad/m), amplitudes (m) and phases: slopes of 0.2, no shadows at 45 degrees.
RNG = np.random.default_rng(7)
ANGLES = RNG.uniform(0, np.pi, 14)
WAVES = RNG.uniform(0.5, 1.6, (14, 1)) * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
AMPLITUDES = 0.07 / np.linalg.norm(WAVES, axis=1)
PHASES = RNG.uniform(0, 2 * np.pi, 14)


class Waves:
    """Ground around a grid: heights, slopes, photographs."""

    def __init__(self, grid: MapletGrid) -> None:
        self.grid = grid

    def height(self, x, y):
        """Heights (…), metres, at metres along Ux and Uy."""
        turns = x[..., None] * WAVES[:, 0] + y[..., None] * WAVES[:, 1] + PHASES
        return np.sin(turns) @ AMPLITUDES

    def slopes(self, x, y):
        turns = x[..., None] * WAVES[:, 0] + y[..., None] * WAVES[:, 1] + PHASES
        cosines = np.cos(turns)
        return cosines @ (AMPLITUDES * WAVES[:, 0]), cosines @ (AMPLITUDES * WAVES[:, 1])

    def heights(self):
        """Heights on the grid (2q+1, 2q+1)."""
        steps = self.grid.offsets * self.grid.gsd
        return self.height(*np.meshgrid(steps, steps))

    def camera(self, toward, *, pixel, size=160, distance=2000.0):
        """State of an image from `toward` (local, any length), pixels of so many metres."""
        toward = np.asarray(toward, dtype=float) / np.linalg.norm(toward)
        away = toward @ self.grid.axes
        across = np.cross(self.grid.uy, -away)
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(-away, across), -away])
        per_mm = distance / (pixel * 100.0)
        middle = (size + 1) / 2
        camera = Camera(
            100.0, [middle, middle], [[per_mm, 0, 0], [0, per_mm, 0]], size, size
        )  # fmt: skip
        position = self.grid.center + distance * away
        return camera, axes, -position

    def photograph(self, name, toward, sun, *, pixel=0.5, samples=3, **options):
        """An image of the ground in the light of `sun` (local): mean of rays in each pixel."""
        camera, axes, scobj = self.camera(toward, pixel=pixel, **options)
        sun = np.asarray(sun, dtype=float) / np.linalg.norm(sun)
        eye = self.grid.axes @ (-scobj - self.grid.center)
        total = np.zeros((camera.height, camera.width))
        steps = (np.arange(samples) + 0.5) / samples - 0.5
        line, column = np.indices(total.shape) + 1.0
        for down in steps:
            for aside in steps:
                focal = np.stack(
                    [
                        (column + aside - camera.center[0]) / camera.k_matrix[0, 0],
                        (line + down - camera.center[1]) / camera.k_matrix[1, 1],
                        np.full(total.shape, camera.focal_length_mm),
                    ],
                    axis=-1,
                )
                beam = focal @ axes @ self.grid.axes.T
                total += self._brightness(eye, beam, sun)
        pixels = np.rint(20000.0 * total / samples**2).astype(np.uint16)
        return SpcImage(
            name, "2019 JAN 01 00:00:00.000", camera, scobj, axes, sun @ self.grid.axes,
            (100, 65000), np.full(3, 0.2), np.full(3, 1e-5), pixels=pixels,
        )  # fmt: skip

    def _along(self, eye, beam):
        """How far beams (…, 3) from the eye reach, local; Newton's method on the height."""
        along = -eye[2] / beam[..., 2]
        for _ in range(6):
            x, y, z = np.moveaxis(eye + along[..., None] * beam, -1, 0)
            tx, ty = self.slopes(x, y)
            falling = beam[..., 2] - tx * beam[..., 0] - ty * beam[..., 1]
            along = along - (z - self.height(x, y)) / falling
        return along

    def _brightness(self, eye, beam, sun):
        """What beams (…, 3) from the eye see, local."""
        along = self._along(eye, beam)
        x, y, _ = np.moveaxis(eye + along[..., None] * beam, -1, 0)
        tx, ty = self.slopes(x, y)
        steep = np.sqrt(1 + tx**2 + ty**2)
        incidence = (sun[2] - tx * sun[0] - ty * sun[1]) / steep
        return lambert(incidence, np.ones_like(incidence), np.zeros_like(incidence))


class Cap(Waves):
    """The waves on a ball of 40 m."""

    def height(self, x, y):
        return super().height(x, y) - (x**2 + y**2) / 80.0

    def slopes(self, x, y):
        along_x, along_y = super().slopes(x, y)
        return along_x - x / 40.0, along_y - y / 40.0


class Painted(Waves):
    """Waves of three times the length, with an albedo that varies by a tenth."""

    def height(self, x, y):
        return 3.0 * super().height(x / 3.0, y / 3.0)

    def slopes(self, x, y):
        return super().slopes(x / 3.0, y / 3.0)

    def albedo(self, x, y):
        return 1.0 + 0.1 * np.sin(0.5 * x + 0.4) * np.cos(0.4 * y)

    def _brightness(self, eye, beam, sun):
        along = self._along(eye, beam)
        x, y, _ = np.moveaxis(eye + along[..., None] * beam, -1, 0)
        return super()._brightness(eye, beam, sun) * self.albedo(x, y)

    def cell_albedo(self):
        steps = (self.grid.offsets[1:] - 0.5) * self.grid.gsd
        painted = self.albedo(*np.meshgrid(steps, steps))
        return painted / painted.mean()


class Ridge(Painted):
    """A ridge along Uy, 2 m high, which casts a shadow where the Sun is low; painted."""

    def height(self, x, y):
        return 2.0 * np.exp(-0.125 * x**2) + 0.0 * y

    def slopes(self, x, y):
        return -0.25 * x * self.height(x, y), 0.0 * y

    def shaded(self, x, y, sun):
        """Whether rays to the Sun meet the ridge."""
        along = np.linspace(0.1, 12.0, 80)[:, None, None]
        above = self.height(x, y) + along * sun[2]
        return (self.height(x + along * sun[0], y + along * sun[1]) > above).any(axis=0)

    def _brightness(self, eye, beam, sun):
        along = self._along(eye, beam)
        x, y, _ = np.moveaxis(eye + along[..., None] * beam, -1, 0)
        return np.where(self.shaded(x, y, sun), 0.0, super()._brightness(eye, beam, sun))
