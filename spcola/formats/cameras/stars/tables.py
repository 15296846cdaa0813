"""Tables of a star calibration: the catalogue, measured positions, and approximate attitudes.

All have a header line; names count without signs and capitals.

catalogue
    ``ra`` and ``dec`` (degrees, the images' inertial frame and epoch), ``mag``.
positions
    ``image``, ``pixel``, ``line`` (the first pixel's centre is 1, 1) and, if known,
    ``sigma`` (pixels) or ``sigma_pixel``, ``sigma_line`` and ``correlation``.
attitudes
    ``image``; ``ra``, ``dec`` of the boresight and ``twist`` in degrees: the angle from the east to
    Cx, towards the north; if known ``vx``, ``vy``, ``vz`` (km/s, barycentric: stellar aberration),
    ``sigma`` (degrees) of a known attitude, and ``file``, the image itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.stars import StarCatalogue, StarPositions
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.cameras.stars.columns import NamedColumns, by_value, read_columns
from spcola.formats.text import KM

_RA = ("ra", "radeg", "raj2000", "rightascension", "rightascensiondeg")
_DEC = ("dec", "decdeg", "dej2000", "decj2000", "de", "declination", "declinationdeg")
_MAGNITUDE = ("mag", "magnitude", "vmag", "v", "gmag", "vtmag")
_IMAGE = ("image", "name", "picture")
_DEFAULT_SIGMA_PX = 0.1


@dataclass(frozen=True, eq=False)
class NominalAttitude:
    """What is known of an image's attitude before.

    Parameters
    ----------
    axes : (3, 3) ndarray
        Rows Cx, Cy, Cz, inertial.
    velocity : (3,) ndarray
        Barycentric, m/s; zero if it is unknown.
    sigma : float
        Radians; infinite if the attitude is only approximate.
    file : Path or None
        The image.
    """

    axes: FloatArray
    velocity: FloatArray
    sigma: float
    file: Path | None


def read_star_catalogue(path: str | Path) -> StarCatalogue:
    """Read a catalogue: right ascensions, declinations, magnitudes.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If a column is missing, a word is no number, or a declination is above 90°.
    """
    table = read_columns(path)
    ra, dec = _angles(table)
    return StarCatalogue.from_angles(ra, dec, table.numbers(_MAGNITUDE))


def read_star_positions(path: str | Path) -> dict[str, StarPositions]:
    """Read measured positions, by image.

    Without a sigma each coordinate has 0.1 pixel.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If a column is missing, a word is no number, or a covariance is not positive.
    """
    table = read_columns(path)
    pixel, line = table.numbers(("pixel", "sample", "x")), table.numbers(("line", "y"))
    both = table.numbers(("sigma", "sigmapx"), default=_DEFAULT_SIGMA_PX)
    one = both if table.find(("sigmapixel",)) is None else table.numbers(("sigmapixel",))
    two = both if table.find(("sigmaline",)) is None else table.numbers(("sigmaline",))
    mixed = table.numbers(("correlation",), default=0.0) * one * two
    covariance = np.stack([one**2, mixed, mixed, two**2], axis=-1).reshape(-1, 2, 2)
    flux = table.numbers(("flux",), default=np.nan)
    found = {}
    for name, at in by_value(_names(table)).items():
        try:
            found[name] = StarPositions(pixel[at], line[at], covariance[at], flux[at])
        except InvalidValueError as error:
            raise FormatError(f"image {name}: {error}", path) from error
    return found


def read_attitudes(path: str | Path) -> dict[str, NominalAttitude]:
    """Read approximate attitudes, by image.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If a column is missing, a word is no number, or an image comes twice.
    """
    table = read_columns(path)
    ra, dec = _angles(table)
    twist = np.radians(table.numbers(("twist", "twistdeg")))
    sigma = np.radians(table.numbers(("sigma", "sigmadeg"), default=np.inf))
    speeds = [table.numbers((name, f"{name}kms"), default=0.0) for name in ("vx", "vy", "vz")]
    files = table.texts(("file",))
    found: dict[str, NominalAttitude] = {}
    for name, places in by_value(_names(table)).items():
        at = places[0]
        if len(places) > 1:
            raise FormatError(f"image {name} comes twice", f"{path}, line {table.lines[places[1]]}")
        velocity = KM * np.array([speed[at] for speed in speeds])
        file = None if files is None or not files[at] else Path(path).parent / files[at]
        if not sigma[at] > 0:
            raise FormatError("sigma must be positive", f"{path}, line {table.lines[at]}")
        found[name] = NominalAttitude(_axes(ra[at], dec[at], twist[at]), velocity, sigma[at], file)
    return found


def _axes(ra: float, dec: float, twist: float) -> FloatArray:
    """Return camera axes (3, 3), rows inertial."""
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    ahead = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    north = np.cross(ahead, east)
    across = np.cos(twist) * east + np.sin(twist) * north
    return np.stack([across, np.cross(ahead, across), ahead])


def _angles(table: NamedColumns) -> tuple[FloatArray, FloatArray]:
    """Return right ascensions and declinations (N,), radians.

    Raises
    ------
    FormatError
        If one is beyond its range: radians or hours have other numbers, but not always.
    """
    ra, dec = table.numbers(_RA), table.numbers(_DEC)
    wrong = np.flatnonzero((np.abs(dec) > 90.0) | (np.abs(ra) > 360.0))
    if len(wrong):
        raise FormatError(
            f"RA {ra[wrong[0]]:g}, Dec {dec[wrong[0]]:g} are no angles in degrees",
            f"{table.path}, line {table.lines[wrong[0]]}",
        )
    return np.radians(ra), np.radians(dec)


def _names(table: NamedColumns) -> list[str]:
    """Return the images' names.

    Raises
    ------
    FormatError
        If there is no such column.
    """
    names = table.texts(_IMAGE)
    if names is None:
        raise FormatError(f"has no column image; it has {', '.join(table.names)}", table.path)
    return names
