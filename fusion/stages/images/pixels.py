"""Pixels of one image: from its file to the .DAT file, and what they contain."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from fusion.stages.images.record import PixelFacts
from fusion.stages.images.turns import Turn
from spcola.arrays import AnyArray, FloatArray
from spcola.camera.detector import (
    BitDepth,
    PixelValues,
    Preparation,
    PreparedPixels,
    SmearTimes,
    prepare_pixels,
)
from spcola.errors import InvalidValueError, NotObservableError, WorkspaceError
from spcola.formats.images import ImageFile, open_image, write_image_data
from spcola.formats.text import read_bytes

_CHUNK = 1 << 20
# Edge lines and columns that show brightness going through the whole frame.
_RIM = 16
# Smear is darker than this share of bright ground.
_BELOW_GROUND = 0.7
# In a picture with fewer levels many pixels have the largest one.
_FEW_LEVELS = 64
# Enough for a percentile, and for a correlation.
_SAMPLES, _LINES = 1 << 16, 64


@dataclass(frozen=True, eq=False)
class Recipe:
    """What is done to the pixels of all images.

    Parameters
    ----------
    dark, flat : Path, optional
        Dark frame and flat field, in any format of images.
    dark_scale : float
        Ratio of the exposure times of image and dark frame.
    bits : {8, 16}, optional
    turn : Turn
    smear : SmearTimes, optional
        Smear is removed if given.
    low, high : int, optional
        Thresholds in DN; by the histogram if not given.
    gamma : float
        Brightness is the number in a file to this power.
    bright_background : bool
        Whether the body lies in front of something brighter; then `high` is found between both.
    """

    dark: Path | None = None
    flat: Path | None = None
    dark_scale: float = 1.0
    bits: Literal[8, 16] | None = None
    turn: Turn = Turn.AS_STORED
    smear: SmearTimes | None = None
    low: int | None = None
    high: int | None = None
    bright_background: bool = False
    gamma: float = 1.0

    @cached_property
    def digest(self) -> str:
        """Equal for equal treatment: the content of the frames counts, not their names."""
        frames = ["" if p is None else file_digest(p) for p in (self.dark, self.flat)]
        more = (self.smear, self.low, self.high, self.bright_background)
        content = repr((
            *frames, self.dark_scale if self.dark else 1.0, self.bits, str(self.turn),
            *(more if any(value is not None and value is not False for value in more) else ()),
            *(("gamma", self.gamma) if self.gamma != 1.0 else ()),
        ))  # fmt: skip
        return hashlib.sha256(content.encode()).hexdigest()

    @property
    def chooses_thresholds(self) -> bool:
        """Whether the user said something about thresholds."""
        return self.low is not None or self.high is not None or self.bright_background

    def preparation(self) -> Preparation:
        """Read the frames."""
        dark, flat = (None if path is None else _frame(path) for path in (self.dark, self.flat))
        return Preparation(
            dark=dark, flat=flat, dark_scale=self.dark_scale, bits=self.bits, low=self.low,
            high=self.high, bright_background=self.bright_background, gamma=self.gamma,
        )  # fmt: skip


def file_digest(*paths: Path) -> str:
    """Return SHA-256 of the contents of files.

    Raises
    ------
    WorkspaceError
        If one cannot be read.
    """
    digest = hashlib.sha256()
    for path in paths:
        try:
            with path.open("rb") as stream:
                while part := stream.read(_CHUNK):
                    digest.update(part)
        except OSError as error:
            raise WorkspaceError(f"cannot be read ({error.strerror})", path) from error
    return digest.hexdigest()


@dataclass(frozen=True)
class PixelWork:
    """One image to be written.

    Parameters
    ----------
    path : Path
        Of the image.
    size : (2,) of int, optional
        Samples and lines of a .DAT file.
    target : Path
        The .DAT file.
    """

    path: Path
    size: tuple[int, int] | None
    target: Path


def write_pixels(work: PixelWork, preparation: Preparation, recipe: Recipe) -> PixelFacts:
    """Write the .DAT file of an image; one of the same content is left as it is.

    Parameters
    ----------
    work : PixelWork
    preparation : Preparation
        That of `recipe`, whose frames are read once for all images.
    recipe : Recipe

    Raises
    ------
    FormatError
        If the image cannot be read.
    InvalidValueError
        If a dark frame or flat field has another size, the exposure time is unknown, or there is no
        brighter background.
    WorkspaceError
        If there is a .DAT file with other content, or it cannot be written.
    """
    image = open_image(work.path, size=work.size)
    if recipe.smear is not None:
        preparation = _without_smear(preparation, recipe.smear, image)
    prepared = _prepared(image.read(), preparation, work.path)
    stored = prepared.stored
    dn = np.ascontiguousarray(recipe.turn.orientation.apply(stored.dn))
    big = dn.astype(dn.dtype.newbyteorder(">")).tobytes()
    sha = hashlib.sha256(big).hexdigest()
    if work.target.exists():
        if hashlib.sha256(read_bytes(work.target)).hexdigest() != sha:
            raise WorkspaceError(
                f"holds other pixels than {work.path.name}",
                work.target,
                "name the image differently (--letter), or move the file",
            )
    else:
        write_image_data(work.target, dn)
    low, high = prepared.thresholds
    return PixelFacts(
        sha, stored.depth.bits, (low, high), stored.depth.gain, stored.depth.offset,
        stored.missing, stored.saturated, stored.below, stored.above, *_contents(dn, low),
    )  # fmt: skip


def _without_smear(preparation: Preparation, times: SmearTimes, image: ImageFile) -> Preparation:
    """Return the preparation of an image whose smear is removed.

    Raises
    ------
    InvalidValueError
        If its exposure time is unknown, or shorter than the transfer of a line.
    """
    exposure = times.exposure_s or image.label.exposure_s
    if exposure is None:
        raise InvalidValueError(
            "its label states no exposure time, which removal of smear needs",
            image.path,
            "give --exposure-s, or --smear-s 0 to leave the smear",
        )
    try:
        return replace(preparation, smear=times.transfer(exposure))
    except InvalidValueError as error:
        raise InvalidValueError(f"{error.where} {error.what}", image.path, error.do) from error


def _prepared(pixels: PixelValues, preparation: Preparation, path: Path) -> PreparedPixels:
    """Return pixels and thresholds; those of a frame without any light too."""
    try:
        return prepare_pixels(pixels, preparation)
    except NotObservableError as error:
        if preparation.bright_background:
            raise InvalidValueError(
                f"{error.where} {error.what}",
                path,
                "give --high DN, or import it without --bright-background",
            ) from error
        return prepare_pixels(pixels, replace(preparation, low=1))
    except InvalidValueError as error:
        # What cannot be scaled is kept as numbers from 0: triage names empty frames.
        if not (pixels.valid.any() and pixels.values[pixels.valid].max() > 0):
            bits: Literal[8, 16] = preparation.bits or (
                8 if pixels.values.dtype.itemsize == 1 else 16
            )
            kept = replace(preparation, low=1, high=None, bright_background=False)
            return prepare_pixels(pixels, replace(kept, depth=BitDepth(bits)))
        raise InvalidValueError(f"{error.where}: {error.what}", path, error.do) from error


def _contents(dn: AnyArray, low: int) -> tuple[float, float, float, float, float, float]:
    """Return what :class:`PixelFacts` states of the picture, from `lit` to `lines`."""
    lit = dn >= low
    count = int(np.count_nonzero(lit))
    if not count:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    largest = int(dn.max())
    brightest = np.count_nonzero(dn == largest) / count if largest >= _FEW_LEVELS else 0.0
    rim = np.concatenate([lit[0], lit[-1], lit[1:-1, 0], lit[1:-1, -1]])
    ground = float(np.percentile(dn[lit][:: max(count // _SAMPLES, 1)], 90.0))
    edges = [_through(turned, ground) for turned in (dn, dn.T)]
    return count / dn.size, brightest, float(rim.mean()), _likeness(dn), edges[0], edges[1]


def _likeness(dn: AnyArray) -> float:
    """Return the correlation of neighbours along lines, from some lines; 0 in uniform frames."""
    lines = dn[:: max(len(dn) // _LINES, 1)].astype(np.float64)
    lines = lines - lines.mean()
    power = float(np.mean(lines * lines))
    return float(np.mean(lines[:, 1:] * lines[:, :-1])) / power if power > 0.0 else 0.0


def _through(dn: AnyArray, ground: float) -> float:
    """Return how much of the brightness of lit ground runs along columns from edge to edge.

    The profile across the frame is the same at its first and its last lines where charge was
    moved through the frame, and darker than ground. 0 for other profiles.
    """
    width = dn.shape[1] // _RIM * _RIM
    if width < 8 * _RIM or len(dn) < 4 * _RIM:
        return 0.0
    profiles = [
        part[:, :width].mean(axis=0).reshape(-1, _RIM).mean(axis=1)
        for part in (dn[:_RIM], dn[-_RIM:])
    ]
    if max(float(one.max()) for one in profiles) > _BELOW_GROUND * ground:
        return 0.0
    first, last = (one - one.mean() for one in profiles)
    covariance, spread = float(np.mean(first * last)), float(np.std(first) * np.std(last))
    return float(np.sqrt(covariance) / ground) if covariance > 0.9 * spread > 0.0 else 0.0


def _frame(path: Path) -> FloatArray:
    """Return a dark frame or flat field; NaN where it has no value."""
    pixels = open_image(path).read()
    values: FloatArray = np.where(pixels.valid, pixels.values.astype(np.float64), np.nan)
    return values
