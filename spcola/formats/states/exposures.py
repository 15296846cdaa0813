"""Tables of exposures (CSV with a header): name and time of each image.

Columns are ``image`` (or ``name``, ``file``, ``picture``), and ``et``, ``utc`` (or ``time``) or
``clock`` (a count of the spacecraft's clock). With ``exposure_s`` or ``exposure_ms`` the time is
the start of the exposure, without them its middle.
``filter`` is its name or number.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from spcola.errors import FormatError
from spcola.formats.images.open_image import open_image
from spcola.formats.states.columns import Row, image_rows

_EXPOSURES = {"exposure_s": 1.0, "exposure_ms": 1e-3}


@dataclass(frozen=True)
class Exposure:
    """Time of an image.

    Parameters
    ----------
    name : str
        Of the image.
    time : float or None
        Ephemeris time, s; None where the clock's count gives it.
    clock : str
        Count of the spacecraft's clock; empty where the time is known.
    delay_s : float
        From that time to the middle of the exposure, seconds.
    filter : str, optional
        Name or number of the filter.
    """

    name: str
    time: float | None
    clock: str = ""
    delay_s: float = 0.0
    filter: str | None = None


def read_exposures(path: str | Path) -> list[Exposure]:
    """Read names and times of images.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If an image has no time, a time cannot be read, or an image appears twice.
    """
    return [_exposure(name, row) for name, row in image_rows(path, {}).items()]


def _exposure(name: str, row: Row) -> Exposure:
    """Return the exposure on one line."""
    time, clock = row.time(), row.text(("clock",)) or ""
    if (time is None) == (not clock):
        raise FormatError("states no time, or two", row.place, "name a column utc, et or clock")
    delay = 0.0
    for column, unit in _EXPOSURES.items():
        length = row.numbers((column,))
        if length is not None:
            if length[0] < 0.0:
                raise FormatError(f"{column} is negative", row.place)
            delay = unit * float(length[0]) / 2.0
    return Exposure(name, time, clock, delay, row.text(("filter",)))


def exposure_of(path: str | Path) -> Exposure:
    """Return the exposure that the label of an image states.

    Parameters
    ----------
    path : str or Path
        FITS, PDS3, PDS4, ISIS cube.

    Raises
    ------
    FormatError
        If it is no image, or its label does not determine the middle of the exposure.
    """
    label = open_image(path).label
    middle = label.mid_exposure()
    if middle is None:
        raise FormatError(
            "the label does not state when it was exposed", path, "give a table of the times"
        )
    return Exposure(Path(path).stem, middle.et, filter=label.filter)
