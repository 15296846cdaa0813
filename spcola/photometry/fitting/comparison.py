"""Which of several fitted photometric functions the data prefer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spcola.photometry.fitting.fit import Doubt, PhotometricFit
from spcola.photometry.fitting.samples import PhotometricSamples

# Standard deviations by which χ² has to differ between two functions.
_APART = 2.0


@dataclass(frozen=True)
class Standing:
    """How one function does.

    Attributes
    ----------
    fit : PhotometricFit
    chi_square : float
        Of the independent samples, by the spread of the best function's residuals.
    aic, bic : float
        Akaike's and Schwarz's criteria: less is better.
    worse_by : float
        χ² above that of the preferred function, standard deviations: of its sum over places.
    as_good : bool
        Whether the data cannot distinguish it from the preferred one.
    """

    fit: PhotometricFit
    chi_square: float
    aic: float
    bic: float
    worse_by: float
    as_good: bool


@dataclass(frozen=True)
class Comparison:
    """Functions with the preferred one first, and the number of independent samples."""

    standings: tuple[Standing, ...]
    independent: float


def compare_fits(samples: PhotometricSamples, fits: Sequence[PhotometricFit]) -> Comparison:
    """Rank fits of one set of samples by Schwarz's criterion.

    Samples of one place have common errors (slopes, albedo): χ² and the number of samples are
    divided by the design effect. Two functions are distinguished by the differences of χ² of the
    places, whose scatter gives the error of their sum (Vuong 1989, with clusters).
    """
    best = min(fits, key=lambda fit: fit.spread)
    loss = [fit.chi_square(best.spread) for fit in fits]
    # The effect on what distinguishes functions: on their parameters, if any has some.
    effects = [fit.design_effect for fit in fits if fit.function.parameters]
    effect = float(np.median(effects)) if effects else best.design_effect
    independent = len(samples) / effect
    ranked = []
    for fit, each in zip(fits, loss, strict=True):
        undetermined = [code for code, _ in fit.doubts.values() if code is Doubt.UNDETERMINED]
        unknowns = len(fit.function.parameters) - len(undetermined)
        chi = float(each.sum()) / effect
        ranked.append((chi + np.log(independent) * unknowns, chi, chi + 2.0 * unknowns, fit, each))
    ranked.sort(key=lambda one: one[0])
    reference = ranked[0][4]
    standings = []
    for bic, chi, aic, fit, each in ranked:
        worse = _deviations(np.bincount(samples.place, each - reference))
        standings.append(Standing(fit, chi, aic, bic, worse, worse < _APART))
    return Comparison(tuple(standings), independent)


def _deviations(differences: np.ndarray) -> float:
    """Return a sum over places in standard deviations of it."""
    total, count = float(differences.sum()), differences.size
    if count < 2 or total == 0.0:
        return 0.0
    error = float(np.std(differences, ddof=1)) * np.sqrt(count)
    return total / error if error > 0.0 else float(np.inf)
