"""Raw frames of a frame-transfer detector: bias, dark current, flat field, smear, noise, bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from spcola.arrays import AnyArray, FloatArray, read_only
from spcola.errors import SettingsError

RAW_BITS = (8, 10, 12, 14)
# Temperature at which dark currents are stated, °C, and warming that doubles them, K.
_REFERENCE_C, _DOUBLING_K = -20.0, 7.0
# Unevenness of dark current and sensitivity has this correlation, over the detector's width.
_SMOOTH_SHARE = 0.15


@dataclass(frozen=True)
class DetectorSettings:
    """Properties of the detectors of all cameras.

    Parameters
    ----------
    bits : {8, 10, 12, 14}
        Depth of the numbers (DN); they are stored in 16 bits.
    bias : float
        DN of a pixel without charge.
    full_well : float
        Electrons at the largest number.
    read_noise : float
        Electrons, one standard deviation.
    dark_rate : float
        Dark current at −20 °C, DN/s; doubled by each 7 K.
    hot_share, hot_factor : float
        Share of hot pixels, and their dark current in units of the others'.
    flat_noise, vignetting : float
        Differences of sensitivity: rms from pixel to pixel, and loss in the corners.
    transfer : float
        Time of the frame transfer, s, during which light still falls: the smear.
    temperature_c, temperature_swing : float
        Mean temperature of the detectors, and its amplitude over a day, °C.
    exposure_share : float
        Share of the largest number that the brightest ground reaches.
    responsivity : float
        DN/s at an I/F of 1, of MapCam; that of PolyCam is a third.

    Raises
    ------
    SettingsError
        If a value lies outside its range.
    """

    bits: int = 12
    bias: float = 120.0
    full_well: float = 24_000.0
    read_noise: float = 20.0
    dark_rate: float = 30.0
    hot_share: float = 3e-4
    hot_factor: float = 60.0
    flat_noise: float = 0.008
    vignetting: float = 0.06
    transfer: float = 2.0e-4
    temperature_c: float = -18.0
    temperature_swing: float = 4.0
    exposure_share: float = 0.65
    responsivity: float = 6.0e6

    def __post_init__(self) -> None:
        if self.bits not in RAW_BITS:
            raise SettingsError(f"must be one of {RAW_BITS}, not {self.bits}", "bits of raw images")
        if not 0 <= self.bias < 0.5 * self.largest or not 0 < self.exposure_share < 1:
            raise SettingsError("bias or share of the exposure out of range", "detector")
        levels = (self.read_noise, self.dark_rate, self.hot_factor, self.flat_noise, self.transfer)
        if min(levels) < 0 or min(self.full_well, self.responsivity) <= 0:
            raise SettingsError("must not be negative", "noise, dark, flat or smear")
        if not (0 <= self.hot_share < 0.1 and 0 <= self.vignetting < 0.5):
            raise SettingsError("hot pixels or vignetting out of range", "detector")

    @property
    def largest(self) -> int:
        """The largest number of a pixel."""
        return int(2**self.bits - 1)

    def responsivity_of(self, camera: str) -> float:
        """Return the DN/s of a `camera` at an I/F of 1."""
        return self.responsivity / (3.0 if camera == "PolyCam" else 1.0)

    def exposure_for(self, iof: float, camera: str) -> float:
        """Return the exposure, s, to 0.1 ms, that brings ground to the stated share.

        Parameters
        ----------
        iof : float
            I/F of that ground.
        camera : str
        """
        wanted = self.exposure_share * (self.largest - self.bias)
        return max(1e-4, round(wanted / (iof * self.responsivity_of(camera)), 4))

    def temperature_at(self, time: float) -> float:
        """Return the temperature of the detectors, °C, to 0.01, at an ephemeris time, s."""
        day = 2.0 * np.pi * (time % 86400.0) / 86400.0
        return round(self.temperature_c + self.temperature_swing * float(np.sin(day)), 2)


@dataclass(frozen=True, eq=False)
class Detector:
    """One detector with its patterns.

    Attributes
    ----------
    settings : DetectorSettings
    camera : str
    dark : (NLN, NPX) ndarray
        Dark current at −20 °C, DN/s.
    flat : (NLN, NPX) ndarray
        Relative sensitivity, of mean 1.
    """

    settings: DetectorSettings
    camera: str
    dark: FloatArray
    flat: FloatArray

    @classmethod
    def drawn(
        cls, settings: DetectorSettings, camera: str, size: int, generator: np.random.Generator
    ) -> Detector:
        """Draw the patterns of a square detector.

        Parameters
        ----------
        settings : DetectorSettings
        camera : str
            Its name.
        size : int
            Pixels across.
        generator : numpy.random.Generator
        """
        shape = (size, size)
        uneven = gaussian_filter(generator.standard_normal(shape), _SMOOTH_SHARE * size)
        uneven /= max(float(np.abs(uneven).max()), 1e-12)
        dark = settings.dark_rate * (1.0 + 0.2 * uneven)
        dark *= 1.0 + 0.1 * generator.standard_normal(shape)
        hot = generator.random(shape) < settings.hot_share
        dark = np.maximum(np.where(hot, settings.hot_factor * dark, dark), 0.0)
        line, pixel = np.mgrid[-1.0 : 1.0 : size * 1j, -1.0 : 1.0 : size * 1j]
        flat = 1.0 - settings.vignetting * (line**2 + pixel**2) / 2.0
        flat *= 1.0 + settings.flat_noise * generator.standard_normal(shape)
        return cls(settings, camera, read_only(dark), read_only(flat / flat.mean()))

    def dark_at(self, temperature_c: float) -> FloatArray:
        """Return the dark current (NLN, NPX), DN/s, at a `temperature_c`, °C."""
        warmer: FloatArray = self.dark * 2.0 ** ((temperature_c - _REFERENCE_C) / _DOUBLING_K)
        return warmer

    def signal(self, iof: FloatArray, exposure: float, temperature_c: float) -> FloatArray:
        """Return the mean numbers (NLN, NPX) of a frame, without noise and not yet whole.

        Bias, dark current over exposure and transfer, light times the flat field, and smear: while
        the frame is cleared and transferred, each pixel passes all lines of its column.

        Parameters
        ----------
        iof : (NLN, NPX) ndarray
        exposure : float
            Seconds.
        temperature_c : float
        """
        light = self.settings.responsivity_of(self.camera) * iof * self.flat
        smear = self.settings.transfer * light.mean(axis=0, keepdims=True)
        dark = self.dark_at(temperature_c) * (exposure + 0.5 * self.settings.transfer)
        total: FloatArray = self.settings.bias + dark + exposure * light + smear
        return total

    def frame(
        self,
        iof: FloatArray,
        *,
        exposure: float,
        temperature_c: float,
        generator: np.random.Generator,
    ) -> AnyArray:
        """Return a raw frame (NLN, NPX) of int16, from 0 to the largest number.

        Parameters
        ----------
        iof : (NLN, NPX) ndarray
        exposure : float
            Seconds.
        temperature_c : float
        generator : numpy.random.Generator
            Of shot and read noise.
        """
        mean = self.signal(iof, exposure, temperature_c)
        per_electron = self.settings.largest / self.settings.full_well
        shot = per_electron * np.maximum(mean - self.settings.bias, 0.0)
        variance = shot + (per_electron * self.settings.read_noise) ** 2
        noisy = mean + np.sqrt(variance) * generator.standard_normal(mean.shape)
        whole: AnyArray = np.clip(np.rint(noisy), 0, self.settings.largest).astype(np.int16)
        return whole
