"""Significance of a better fit of shots at another place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special
from scipy.fft import dct, idct

from fusion.scaling.misplacement.fit import PlaceFit, clipped
from spcola.arrays import FloatArray

FEWEST_SHOTS = 10
"""Fewest shots of a fit, which has eight parameters."""

FEWEST_INDEPENDENT = 12
"""Fewest independent shots for a better place: parameters and rotation take eleven."""

LARGER = 1.2
"""Smallest ratio of the scatter here to that at another place that counts as a difference."""

# Number of noise series drawn: a chance of one in a thousand is two of them.
_DRAWS = 2000


def chance_of_larger(here: FloatArray, there: FloatArray) -> float:
    """p-value of a larger scatter of residuals here than there, if both fits are equally good.

    The regression coefficient β of residuals here on their difference from those there is 0 if the
    fit here is correct, 1 if that there is, and ½ if both scatter equally (the test of Pitman 1939
    and Morgan 1939). Errors of consecutive shots may be correlated: the effective number of shots
    follows from the correlations along the track (Pyper & Peterman 1998). These are poorly
    determined for a short track, for which :func:`chance_of_fit` is decisive.

    Parameters
    ----------
    here, there : (N,) ndarray
        Residuals of the same shots, in order of time; NaN where unknown.

    Returns
    -------
    float
        One-sided p-value of β against ½. 1 if all residuals there are NaN, 0 if only those here
        are.
    """
    if not np.isfinite(there).any():
        return 1.0
    if not np.isfinite(here).any():
        return 0.0
    both = np.isfinite(here) & np.isfinite(there)
    if np.count_nonzero(both) < FEWEST_SHOTS:
        return 1.0
    one, other = clipped(here[both]), clipped(there[both])
    one, less = one - one.mean(), (one - other) - (one - other).mean()
    size = float(less @ less)
    if not size > 0:
        return 1.0
    share = float(one @ less) / size
    rest = one - share * less
    count = independent(rest, less)
    error = float(np.sqrt((rest @ rest) / size / (count - 2.0)))
    return float(special.stdtr(count - 2.0, -(share - 0.5) / max(error, 1e-12)))


def independent(one: FloatArray, other: FloatArray) -> float:
    """Effective number, 4 to N, of independent pairs of two series (N,), each of mean 0."""
    count = len(one)
    own = np.correlate(one, one, "full")[count - 1 :] / (one @ one)
    others = np.correlate(other, other, "full")[count - 1 :] / (other @ other)
    lags = np.arange(1, max(2, count // 5 + 1))
    common = float(np.sum((1.0 - lags / count) * own[lags] * others[lags]))
    return float(np.clip(count / max(1.0 + 2.0 * common, 1.0), 4.0, count))


def chance_of_fit(
    here: PlaceFit,
    others: Sequence[PlaceFit],
    *,
    prior: FloatArray,
    loose: FloatArray,
    center: FloatArray,
) -> float:
    """p-value of the best fit at another place, if residuals here are noise of the same spectrum.

    Null hypothesis: the shots are correct here and their residuals are noise. Random signs of their
    cosine transform along the track give noise with the spectrum of the residuals, hence their
    correlation along the track, and no relation to the shape. For each such noise all places are
    fitted again, and the best is compared with the best of the data. Residuals of only a few smooth
    waves have few signs, and give a large p-value.

    Parameters
    ----------
    here : PlaceFit
        At the stated positions.
    others : sequence of PlaceFit
        The same shots at all other places that were searched.
    prior, loose : (8,) ndarray
        Prior sigmas of the parameters here, and at the other places.
    center : (8,) ndarray
        Prior means of the parameters here.

    Returns
    -------
    float
        p-value for all places together, at least 1/2001. 0 if no shot hits the shape here, 1 if
        none does elsewhere.
    """
    if np.count_nonzero(here.hits) < FEWEST_SHOTS:
        return 0.0
    about = PlaceFit(here.hits, here.value - here.design @ center, here.design).trimmed(prior)
    rest = about.rest(prior)
    known = rest[about.hits]
    # The first series is the data.
    noise = np.zeros((len(rest), 1 + _DRAWS))
    noise[about.hits] = np.column_stack([known, drawn(known, _DRAWS)])
    least = np.full(1 + _DRAWS, np.inf)
    for other in others:
        if np.count_nonzero(other.hits & about.hits) >= FEWEST_SHOTS:
            least = np.minimum(least, other.trimmed(loose).squares(loose, noise, rest))
    if not np.isfinite(least[0]):
        return 1.0
    # The scatter here is not refitted for each series: the residuals are already after a fit.
    return float((1 + np.count_nonzero(least[1:] <= least[0])) / (1 + _DRAWS))


def drawn(rest: FloatArray, count: int) -> FloatArray:
    """Noise (N, count) with the spectrum of residuals (N,): a cosine transform, random signs."""
    waves = dct(rest, norm="ortho")
    signs = np.random.default_rng(len(rest)).choice([-1.0, 1.0], size=(len(rest), count))
    noise: FloatArray = idct(waves[:, None] * signs, axis=0, norm="ortho")
    return noise
