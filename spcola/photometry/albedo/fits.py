"""How well images fit, gathered over windows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spcola.camera import SpcImage
from spcola.math.robust import known_median
from spcola.photometry.albedo.windows import Window
from spcola.photometry.photoclinometry import Fit, ImageFit
from spcola.photometry.photoclinometry.image_equations import Compared, ImageState
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.judging import contradicts, noise_of


class Tally:
    """Sums over the pixels of K images, window by window.

    Parameters
    ----------
    count : int
        K.
    """

    def __init__(self, count: int) -> None:
        self._pixels = np.zeros(count)
        # 1, observed, expected, and their products, over the pixels.
        self._sums = np.zeros((count, 6))
        # Noise and side of a pixel (m) of each window.
        self._each: list[list[tuple[float, float]]] = [[] for _ in range(count)]

    def add(
        self, number: int, window: Window, view: ImageWindow, compared: Compared, scale: float
    ) -> None:
        """Add the pixels of an image in a window; those of its margins are in others too."""
        observed = view.pixels[compared.used] / scale
        expected = compared.expected[compared.used]
        relative = np.full(view.pixels.shape, np.nan)
        relative[compared.used] = observed / expected - 1.0
        self._each[number].append((noise_of(relative), view.pixel_m(window.grid.gsd)))
        self._pixels[number] += observed.size * np.mean(window.inside)
        self._sums[number] += [
            observed.size, observed.sum(), expected.sum(),
            observed @ observed, expected @ expected, observed @ expected,
        ]  # fmt: skip

    def fits(
        self, images: Sequence[SpcImage], states: Sequence[ImageState]
    ) -> tuple[ImageFit, ...]:
        """Return how each image fits."""
        return tuple(
            self._fit(number, image.name, state)
            for number, (image, state) in enumerate(zip(images, states, strict=True))
        )

    def _fit(self, number: int, name: str, state: ImageState) -> ImageFit:
        pixels = round(float(self._pixels[number]))
        if not (pixels and np.isfinite(state.spread)):
            return ImageFit.not_seen(name)
        count, *_ = sums = self._sums[number]
        a, b, aa, bb, ab = sums[1:] / count
        scale = float(np.sqrt((aa - a * a) * (bb - b * b)))
        correlation = float(ab - a * b) / scale if scale > 0.0 else 0.0
        fit = Fit.CONTRADICTS if contradicts(correlation, pixels) else Fit.USED
        shift = (float(state.shift[0]), float(state.shift[1]))
        gradient = (float(state.gradient[0]), float(state.gradient[1]))
        noise, pixel_m = known_median(np.array(self._each[number]))
        return ImageFit(
            name, fit, state.scale, shift, state.spread, correlation, pixels, gradient,
            float(noise), float(pixel_m),
        )  # fmt: skip
