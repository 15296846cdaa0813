"""Blur of images: the point spread of the optics, and smear by motion during the exposure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Any, Self

import numpy as np
from scipy import ndimage, optimize, special

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError, SettingsError

__all__ = ["ImageBlur", "ImageBlurs"]

# Largest blur, pixels: more is a mistake of units, or an image that shows nothing.
_MOST_PSF, _MOST_SMEAR = 10.0, 100.0
# Shorter smear is left out: it takes 0.2 % of the contrast of waves of three pixels.
_LEAST_SMEAR = 0.1
# A narrower point spread is too sharp to be sampled at pixels; a kernel is fitted to it then, to
# what a Gaussian of the second width lets through, and reaches so far from the path, pixels.
_SAMPLED, _PASSING, _REACH = 0.8, 1.0, 1.5


@dataclass(frozen=True)
class ImageBlur:
    r"""Blur of an image: a Gaussian, and a path along which each point is smeared evenly.

    Parameters
    ----------
    psf_px : float
        Standard deviation of the optics' point spread, a Gaussian, pixels: 0 to 10.
    smear_px : two floats
        Path of a point in the image during the exposure, along samples and lines, pixels: 100 long
        at most. Its sign does not matter.

    Raises
    ------
    SettingsError
        If a number is out of range.
    """

    psf_px: float = 0.0
    smear_px: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0.0 <= self.psf_px <= _MOST_PSF:
            raise SettingsError(f"must be 0 to {_MOST_PSF:g} pixels, not {self.psf_px}", "psf_px")
        # NaN fails, too.
        if not self.length_px <= _MOST_SMEAR:
            raise SettingsError(
                f"must be a path of {_MOST_SMEAR:g} pixels at most, not {self.length_px:g}",
                "smear_px",
            )

    @property
    def length_px(self) -> float:
        """Length of the smear, pixels."""
        return float(np.hypot(*self.smear_px))

    def applied(self, layers: FloatArray, axes: tuple[int, int], *, block: int = 1) -> FloatArray:
        """Return layers of pixels as the image has them: the same array where it is sharp.

        It is symmetric: what a place gives to pixels through it, and what it takes from them, is
        the same. Beyond the layers is nothing.

        Parameters
        ----------
        layers : ndarray
        axes : two ints
            Which axes are lines and samples.
        block : int
            Pixels of the image along the side of one of these.
        """
        psf = self.psf_px / block
        if self.length_px >= _LEAST_SMEAR * block:
            kernel = _kernel(psf, self.smear_px[0] / block, self.smear_px[1] / block)
            shape = [1] * layers.ndim
            shape[axes[0]], shape[axes[1]] = kernel.shape
            return ndimage.convolve(layers, kernel.reshape(shape), mode="constant")
        if psf == 0.0:
            return layers
        return ndimage.gaussian_filter(layers, psf, mode="constant", axes=axes)


@dataclass(frozen=True)
class ImageBlurs:
    """Blur of images by their names.

    Parameters
    ----------
    rows : tuple of (str, ImageBlur)
        Names of images, or patterns in which ``*`` stands for any letters: a camera's images. A
        name counts more than a pattern.
    """

    rows: tuple[tuple[str, ImageBlur], ...] = ()

    def of(self, image: str, psf_px: float = 0.0) -> ImageBlur:
        """Return the blur of an image.

        Parameters
        ----------
        image : str
            Its name.
        psf_px : float
            Point spread of images that no row names, pixels; they are not smeared.

        Raises
        ------
        InvalidValueError
            If two patterns match it.
        """
        found = self.naming(image)
        if len(found) > 1:
            one, other = (self.rows[k][0] for k in found[:2])
            raise InvalidValueError(
                f"{one} and {other} both name {image}", "image_blur", f"add a row for {image}"
            )
        return self.rows[found[0]][1] if found else ImageBlur(psf_px)

    def naming(self, image: str) -> list[int]:
        """Return the places of the rows that name an image: of its own, or of patterns."""
        found = [k for k in range(len(self.rows)) if self.matches(k, image)]
        return [k for k in found if self.rows[k][0] == image] or found

    def matches(self, row: int, image: str) -> bool:
        """Whether the name or the pattern of a row is that of an image."""
        name = self.rows[row][0]
        # No other sign has a meaning.
        pattern = name.replace("[", "[[]").replace("?", "[?]")
        return name == image or ("*" in name and fnmatchcase(image, pattern))

    def among(self, images: Iterable[str]) -> ImageBlurs:
        """Return the blurs of some images alone, each by its name.

        Raises
        ------
        InvalidValueError
            If two patterns match one.
        """
        named = (one for one in dict.fromkeys(images) if self.naming(one))
        return ImageBlurs(tuple((one, self.of(one)) for one in named))

    def as_json(self) -> list[dict[str, Any]]:
        """Return the rows in JSON types."""
        return [
            {"image": name, "psf_px": blur.psf_px, "smear_px": list(blur.smear_px)}
            for name, blur in self.rows
        ]

    @classmethod
    def of_json(cls, rows: Sequence[Mapping[str, Any]]) -> Self:
        """Return the blurs of the `rows` that :meth:`as_json` wrote."""
        return cls(
            tuple(
                (row["image"], ImageBlur(row["psf_px"], (row["smear_px"][0], row["smear_px"][1])))
                for row in rows
            )
        )


@lru_cache(maxsize=1000)
def _kernel(psf: float, across: float, down: float) -> FloatArray:
    """Return what a point gives to the pixels around it (odd, odd): not negative, sum 1.

    The Gaussian along the path is sampled at pixels if it is wide. A narrow one is not known by its
    samples: the kernel without negative weights is taken that differs least from it, for waves that
    a Gaussian of one pixel lets through (four pixels and longer). Shares of cells have to be
    positive for :func:`spcola.photometry.photoclinometry.cell_pixels.gather_cells`.

    Parameters
    ----------
    psf : float
        Pixels.
    across, down : float
        The path along samples and lines, pixels.
    """
    length = float(np.hypot(across, down))
    reach = max(_REACH, 4.0 * psf)
    sides = [int(np.ceil(0.5 * abs(one) + reach)) for one in (down, across)]
    line, sample = np.indices([2 * side + 1 for side in sides]) - np.reshape(sides, (2, 1, 1))
    along = (sample * across + line * down) / length
    aside = (line * across - sample * down) / length
    near = np.hypot(np.maximum(np.abs(along) - 0.5 * length, 0.0), aside) <= reach
    fitted = psf < _SAMPLED
    variance = psf**2 + (2.0 * _PASSING**2 if fitted else 0.0)
    width = np.sqrt(2.0 * variance)
    ends = [special.erf((along[near] + sign * 0.5 * length) / width) for sign in (1.0, -1.0)]
    weights = np.exp(-((aside[near] / width) ** 2)) * (ends[0] - ends[1])
    if fitted:
        places = np.stack([line[near], sample[near]]).astype(np.float64)
        apart = np.sum((places[:, :, None] - places[:, None, :]) ** 2, axis=0)
        # Least squares by the products of the Gaussians of two pixels, and of one and the path.
        root = np.linalg.cholesky(np.exp(-apart / (4.0 * _PASSING**2)))
        weights, _ = optimize.nnls(root.T, np.linalg.solve(root, weights))
    kernel = np.zeros(near.shape)
    kernel[near] = weights
    # Rounding apart it is symmetric.
    kernel += kernel[::-1, ::-1].copy()
    kernel /= kernel.sum()
    kernel.flags.writeable = False
    return kernel
