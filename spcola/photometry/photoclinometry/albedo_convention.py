"""How relative albedo 1 + tz is normalised and bounded (Gaskell et al., §3.3): the one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import SettingsError
from spcola.math.robust import mad

# Smallest share of its mean that an albedo has.
_LEAST = 0.05


@dataclass(frozen=True)
class AlbedoConvention:
    """Mean and bounds of the relative albedo of a grid.

    While it is solved its mean is 1, whatever the convention: priors and bounds are relative to
    the mean. The result is multiplied by `mean` in :meth:`stated`.

    Parameters
    ----------
    mean : float
        Of a grid. Published: 1; later 0.5, which leaves room for isolated bright areas.
    most : float
        Largest value. Published: 2 with a mean of 1; 2.55, as the byte of a .MAP has it, with 0.5.
    range_sigmas : float
        Largest distance from the median, in robust standard deviations of the grid's albedo:
        outliers are moved there. Infinite: no such bound.

    Raises
    ------
    SettingsError
        If a number is out of range.
    """

    mean: float = 1.0
    most: float = 2.0
    range_sigmas: float = float("inf")

    def __post_init__(self) -> None:
        if not 0.0 < self.mean < np.inf:
            raise SettingsError(f"must be positive, not {self.mean}", "albedo_mean")
        if not self.most > self.mean:
            raise SettingsError(
                f"must exceed the mean, {self.mean:g}, not {self.most}", "albedo_most"
            )
        if not self.range_sigmas > 0.0:
            raise SettingsError(f"must be positive, not {self.range_sigmas}", "albedo_range")

    @classmethod
    def published(cls, mean: float, range_sigmas: float = float("inf")) -> AlbedoConvention:
        """Return the published convention of a mean of 1 or 0.5.

        Parameters
        ----------
        mean : float
        range_sigmas : float
            As the class has it.

        Raises
        ------
        SettingsError
            If there is none of this mean.
        """
        caps = {1.0: 2.0, 0.5: 2.55}
        if mean not in caps:
            raise SettingsError(f"must be 1 or 0.5, not {mean:g}", "albedo_mean")
        return cls(mean, caps[mean], range_sigmas)

    def relative(self, albedo: FloatArray) -> FloatArray:
        """Return an albedo of any convention with mean 1; 1 where it is unknown."""
        known = np.isfinite(albedo)
        if not known.any():
            return np.ones(albedo.shape)
        return np.where(known, albedo / albedo[known].mean(), 1.0)

    def bounded(self, albedo: FloatArray, known: BoolArray | None = None) -> FloatArray:
        """Return an albedo about 1, bounded, its mean over the cells `known` 1.

        Parameters
        ----------
        albedo : (R, C) ndarray
        known : (R, C) ndarray of bool, optional
            All if not given.
        """
        some = albedo if known is None else albedo[known]
        if not some.size:
            return albedo
        least, most = _LEAST, self.most / self.mean
        if np.isfinite(self.range_sigmas):
            middle, reach = float(np.median(some)), self.range_sigmas * float(mad(some))
            least, most = max(least, middle - reach), min(most, middle + reach)
        bounded = np.clip(albedo, least, most)
        mean = (bounded if known is None else bounded[known]).mean()
        whole: FloatArray = np.clip(bounded / mean, _LEAST, self.most / self.mean)
        return whole

    def stated(self, albedo: FloatArray) -> FloatArray:
        """Return an albedo, or its sigma, of mean 1 in this convention."""
        return self.mean * albedo
