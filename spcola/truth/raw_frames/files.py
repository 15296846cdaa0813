"""Raw images and calibration frames as FITS, with the labels of a mission and no state."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray
from spcola.navigation import iso_utc
from spcola.truth.kernels.names import CRAFT, MISSION, TARGET
from spcola.truth.raw_frames.detector import Detector

FILTERS = {"PolyCam": "CLEAR", "MapCam": "PAN"}
"""Filter of each camera."""

PHASES = {"AP": "APPROACH", "PS": "PRELIMINARY SURVEY", "DS": "DETAILED SURVEY"}
"""Names of the phases by the codes of :mod:`spcola.truth.campaign.campaign`."""

Card = tuple[float | int | str, str]


@dataclass(frozen=True)
class RawLabel:
    """What the label of a raw image states.

    Attributes
    ----------
    camera : str
    phase : str
        Code of the phase of the mission.
    time : float
        Ephemeris time of the middle of the exposure, s.
    exposure : float
        Seconds.
    temperature_c : float
        Of the detector, °C.
    clock : str
        Spacecraft clock at the start of the exposure.
    """

    camera: str
    phase: str
    time: float
    exposure: float
    temperature_c: float
    clock: str

    @property
    def start(self) -> str:
        """UTC of the start of the exposure, ISO 8601, to the microsecond."""
        return iso_utc(self.time - 0.5 * self.exposure)

    @property
    def product(self) -> str:
        """Name of the product: middle of the exposure, camera, level."""
        date, clock = iso_utc(self.time, 3).split("T")
        stamp = f"{date.replace('-', '')}T{clock.replace(':', '').replace('.', 'S')}"
        return f"{stamp}_{self.camera[:3].lower()}_raw"

    def cards(self, detector: Detector) -> dict[str, Card]:
        """Return the cards of the header of a frame of a `detector`."""
        settings = detector.settings
        gain = round(settings.full_well / settings.largest, 6)
        return {
            "MISSION": (MISSION, "mission"),
            "TELESCOP": (CRAFT, "spacecraft"),
            "INSTRUME": (self.camera.upper(), "camera"),
            "TARGET": (TARGET, "target body"),
            "FILTER": (FILTERS[self.camera], "filter"),
            "MPHASE": (PHASES.get(self.phase, self.phase), "phase of the mission"),
            "PRODNAME": (self.product, "product"),
            "DATE-OBS": (self.start, "UTC, start of the exposure"),
            "DATE-END": (iso_utc(self.time + 0.5 * self.exposure), "UTC, end of the exposure"),
            "DATE-AVG": (iso_utc(self.time), "UTC, middle of the exposure"),
            "SCLK": (self.clock, "spacecraft clock, start of the exposure"),
            "EXPTIME": (round(self.exposure, 4), "[s] exposure"),
            "CCDTEMP": (self.temperature_c, "[degC] temperature of the detector"),
            "OPTTEMP": (round(self.temperature_c - 5.0, 2), "[degC] temperature of the optics"),
            "BUNIT": ("DN", "raw numbers"),
            "BITDEPTH": (settings.bits, "bits of the numbers"),
            "SATURATE": (settings.largest, "largest number"),
            "XFERTIME": (settings.transfer, "[s] frame transfer without shutter"),
            "GAIN": (gain, "electrons per DN"),
            "RDNOISE": (settings.read_noise, "[electron] read noise"),
            "SAMPDISP": ("RIGHT", "pixels run to the right on display"),
            "LINEDISP": ("DOWN", "the first line is the uppermost on display"),
        }  # fmt: skip


def write_raw_image(
    path: str | Path, pixels: AnyArray, label: RawLabel, detector: Detector
) -> None:
    """Write a raw frame with its label, whole or not at all.

    Parameters
    ----------
    path : str or Path
    pixels : (NLN, NPX) ndarray of int16
    label : RawLabel
    detector : Detector
        Whose frame it is.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    _write(path, pixels, label.cards(detector))


def write_calibration(folder: Path, detector: Detector) -> tuple[Path, ...]:
    """Write dark current and flat field of a detector; return the files.

    Parameters
    ----------
    folder : Path
        Existing folder.
    detector : Detector

    Raises
    ------
    WorkspaceError
        If a file cannot be written.
    """
    name = detector.camera.lower()
    shared: dict[str, Card] = {
        "MISSION": (MISSION, "mission"),
        "INSTRUME": (detector.camera.upper(), "camera"),
        "BIAS": (detector.settings.bias, "[DN] of every pixel"),
        "IOFRESP": (
            detector.settings.responsivity_of(detector.camera), "[DN/s] at an I/F of 1",
        ),
    }  # fmt: skip
    dark: dict[str, Card] = {
        "BUNIT": ("DN/s", "dark current"),
        "CCDTEMP": (-20.0, "[degC] of this dark current"),
        "DOUBLING": (7.0, "[K] of warming that double it"),
    }
    paths = (folder / f"{name}_dark.fits", folder / f"{name}_flat.fits")
    _write(paths[0], detector.dark.astype(np.float32), shared | dark)
    flat: dict[str, Card] = {"BUNIT": ("1", "relative sensitivity")}
    _write(paths[1], detector.flat.astype(np.float32), shared | flat)
    return paths


def _write(path: str | Path, pixels: AnyArray, cards: dict[str, Card]) -> None:
    from astropy.io import fits  # noqa: PLC0415  (a quarter of a second at start-up)

    unit = fits.PrimaryHDU(np.ascontiguousarray(pixels))
    for key, (value, comment) in cards.items():
        unit.header[key] = (value, comment)
    with atomic.replacing(path) as temporary:
        unit.writeto(temporary, overwrite=True)
