"""Images as FITS: the pixels, and a header with camera and state.

The first row of the file is the first line of the image. Lengths are in metres; a card has twenty
characters for a number, so that directions are accurate to about 1e-14.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray, FloatArray
from spcola.camera import Camera, SpcImage
from spcola.errors import FormatError, InvalidValueError, SpcolaError
from spcola.formats.text.fortran import LARGEST_NUMBER
from spcola.formats.text.source import as_format_error, read_bytes

Card = tuple[float | int | str, str]

_VECTORS = {
    "SCOBJ": "[m] spacecraft to body origin, body-fixed",
    "CX": "direction of rising pixel, body-fixed",
    "CY": "direction of rising line, body-fixed",
    "CZ": "boresight, body-fixed",
    "SUN": "direction to the Sun, body-fixed",
}
_SIGMAS = {
    "SIGVS": "[m] 1 sigma of SCOBJ",
    "SIGPT": "[rad] 1 sigma of turns about CX, CY, CZ",
}


def write_fits_image(
    path: str | Path, image: SpcImage, *, cards: Mapping[str, Card] | None = None
) -> None:
    """Write the pixels and the state of an image, whole or not at all.

    Parameters
    ----------
    path : str or Path
    image : SpcImage
        With pixels (uint8 or uint16). Its landmarks and limbs are not written: they belong to
        its .SUM file.
    cards : mapping, optional
        More keywords (at most eight characters), each with value and comment.

    Raises
    ------
    InvalidValueError
        If there are no pixels, or of another type.
    WorkspaceError
        If the file cannot be written.
    """
    from astropy.io import fits  # noqa: PLC0415  (a quarter of a second at start-up)

    pixels = image.pixels
    if pixels is None or pixels.dtype.kind != "u" or pixels.dtype.itemsize > 2:
        raise InvalidValueError("has no pixels of uint8 or uint16", image.name)
    unit = fits.PrimaryHDU(np.ascontiguousarray(pixels))
    for key, (value, comment) in {**_state_cards(image), **(cards or {})}.items():
        unit.header[key] = (value, comment)
    with atomic.replacing(path) as temporary:
        unit.writeto(temporary, overwrite=True)


def read_fits_image(path: str | Path) -> SpcImage:
    """Read an image from a `path` that :func:`write_fits_image` wrote.

    Raises
    ------
    FormatError
        If it is not FITS or cut off, a keyword is missing, or a value is impossible.
    """
    with reading_fits(path) as units:
        pixels: AnyArray = np.array(units[0].data)
        cards = {key: units[0].header[key] for key in units[0].header if key}
    if pixels.ndim != 2 or pixels.dtype.kind != "u" or pixels.dtype.itemsize > 2:
        raise FormatError("holds no image of 8 or 16 bits without sign", path)
    header = _Header(path, cards)
    position, pointing = (header.sigma(key) for key in _SIGMAS)
    with as_format_error(str(path)):
        return SpcImage(
            header.text("IMGNAME"),
            header.text("UTC"),
            header.camera(pixels.shape[1], pixels.shape[0]),
            header.vector("SCOBJ"),
            np.stack([header.vector(key) for key in ("CX", "CY", "CZ")]),
            header.vector("SUN"),
            (int(header.number("THRLOW")), int(header.number("THRHIGH"))),
            position,
            pointing,
            pixels=pixels,
        )


@contextmanager
def reading_fits(path: str | Path) -> Iterator[Any]:
    """Yield the units of the FITS file at `path`, read completely into memory.

    On damaged files astropy warns, or raises various errors. This is the one place that turns all
    of them into one line, so the block must contain nothing but reading.


    Raises
    ------
    FormatError
        If the file cannot be read, or the block fails.
    """
    from astropy.io import fits  # noqa: PLC0415

    content = io.BytesIO(read_bytes(path))
    _check_counts(content.getvalue(), path)
    try:
        # astropy only warns of a file that is cut off.
        with warnings.catch_warnings(action="error"), fits.open(content) as units:
            yield units
    except SpcolaError:
        raise
    except Exception as error:
        raise FormatError(f"cannot be read as FITS ({error})", path) from error


def _check_counts(content: bytes, path: str | Path) -> None:
    """Refuse more axes or columns than FITS allows: astropy reads a keyword for each."""
    for key in (b"NAXIS   =", b"TFIELDS ="):
        at = content.find(key)
        while at >= 0:
            number = content[at + len(key) : at + 80].split(b"/")[0].strip()
            if at % 80 == 0 and not (number.isdigit() and len(number) <= 3):
                name, value = key[:7].decode().strip(), number[:20].decode("ascii", "replace")
                raise FormatError(
                    f"cannot be read as FITS ({name} is {value!r}, and not 0 to 999)", path
                )
            at = content.find(key, at + 1)


class _Header:
    """The cards of a file."""

    def __init__(self, path: str | Path, cards: Mapping[str, Any]) -> None:
        self._path, self._cards = path, cards

    def number(self, key: str) -> float:
        """Return a number; an error if there is none."""
        value = self._cards.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise FormatError("has no number", f"{self._path}: keyword {key}")
        if not abs(value) <= LARGEST_NUMBER:
            raise FormatError(f"has no usable number ({value:g})", f"{self._path}: keyword {key}")
        return float(value)

    def text(self, key: str) -> str:
        """Return a text; an error if there is none."""
        value = self._cards.get(key)
        if not isinstance(value, str):
            raise FormatError("has no text", f"{self._path}: keyword {key}")
        return value

    def vector(self, key: str) -> FloatArray:
        """Return three numbers (3,)."""
        return np.array([self.number(f"{key}_{axis}") for axis in "XYZ"])

    def sigma(self, key: str) -> FloatArray:
        """Return three numbers (3,), NaN if all are missing."""
        known = any(f"{key}_{axis}" in self._cards for axis in "XYZ")
        return self.vector(key) if known else np.full(3, np.nan)

    def camera(self, width: int, height: int) -> Camera:
        """Return the interior orientation."""
        k_matrix = [[self.number(f"K_{row}{column}") for column in "123"] for row in "12"]
        center = np.array([self.number("CTRPIX"), self.number("CTRLINE")])
        count = int(self.number("NDIST"))
        if not 0 <= count <= len(self._cards):
            raise FormatError(f"is {count}", f"{self._path}: keyword NDIST")
        distortion = np.array([self.number(f"DIST_{number + 1}") for number in range(count)])
        focal_mm = self.number("FOCALMM")
        return Camera(
            focal_mm, center, np.array(k_matrix), width, height,
            self.text("DISTMOD"),  # type: ignore[arg-type]  # checked by Camera
            distortion,
        )  # fmt: skip


def _state_cards(image: SpcImage) -> dict[str, Card]:
    """Return the cards of camera and state."""
    camera = image.camera
    cards: dict[str, Card] = {
        "IMGNAME": (image.name, "image"),
        "UTC": (image.utc, "time of the exposure"),
        "FOCALMM": (camera.focal_length_mm, "[mm] focal length"),
        "CTRPIX": (float(camera.center[0]), "pixel of the optical axis, first is 1"),
        "CTRLINE": (float(camera.center[1]), "line of the optical axis, first is 1"),
    }
    for row in range(2):
        for column, unit in enumerate(("x, pixel/mm", "y, pixel/mm", "xy, pixel/mm2")):
            value = float(camera.k_matrix[row, column])
            cards[f"K_{row + 1}{column + 1}"] = (value, f"K-matrix, of {unit}")
    cards["DISTMOD"] = (camera.distortion_model, "model of the distortion")
    cards["NDIST"] = (len(camera.distortion), "number of its coefficients")
    for number, value in enumerate(camera.distortion.tolist(), start=1):
        cards[f"DIST_{number}"] = (value, "coefficient of the distortion")
    cards["THRLOW"] = (image.thresholds[0], "lowest brightness that counts")
    cards["THRHIGH"] = (image.thresholds[1], "highest brightness that counts")
    vectors = dict(zip(_VECTORS, (image.scobj, *image.axes, image.sun), strict=True))
    for key, vector in vectors.items():
        cards |= _vector_cards(key, vector, _VECTORS[key])
    for key, sigma in zip(_SIGMAS, (image.scobj_sigma, image.pointing_sigma), strict=True):
        if np.all(np.isfinite(sigma)):
            cards |= _vector_cards(key, sigma, _SIGMAS[key])
    return cards


def _vector_cards(key: str, vector: FloatArray, comment: str) -> dict[str, Card]:
    """Return the three cards of a vector."""
    return {f"{key}_{axis}": (float(v), comment) for axis, v in zip("XYZ", vector, strict=True)}
