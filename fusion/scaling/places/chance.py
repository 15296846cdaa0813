"""Whether shots fit better at another place by chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats
from scipy.fft import dct, idct

from fusion.scaling.places.fits import PlaceFit, clipped
from spcola.arrays import FloatArray

FEWEST_SHOTS = 10
"""Fewer than this leave nothing once size and centre are taken out."""

FEWEST_INDEPENDENT = 12
"""Independent shots that a better place needs: eight parameters and a turn take eleven."""

LARGER = 1.2
"""Times the scatter at another place that the scatter here has to exceed: less is no difference."""

# Series of noise drawn: one in a thousand is counted by two.
_DRAWS = 2000


def chance_of_larger(here: FloatArray, there: FloatArray) -> float:
    """Chance that residuals scatter more here than there as much as they do, if both fit alike.

    Residuals here are explained by the share β of their difference from those there: 0 where all
    is right here, 1 where it is there, and ½ where both scatter alike (which is the test of Pitman
    1939 and Morgan 1939). Shots that follow each other may err alike: as many of them count as
    the correlations along the track leave independent (Pyper & Peterman 1998). These are
    estimated, and poorly so of a short track: there :func:`chance_of_fit` decides.

    Parameters
    ----------
    here, there : (N,) ndarray
        Residuals of the same shots, in the order in which they were taken; NaN where unknown.

    Returns
    -------
    float
        One-sided p-value of β against ½. 1 where nothing is known there, 0 where nothing is known
        here only.
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
    return float(stats.t.sf((share - 0.5) / max(error, 1e-12), count - 2.0))


def independent(one: FloatArray, other: FloatArray) -> float:
    """How many of N pairs of two series, each of mean 0, count for their correlation: 4 to N."""
    count = len(one)
    own = np.correlate(one, one, "full")[count - 1 :] / (one @ one)
    others = np.correlate(other, other, "full")[count - 1 :] / (other @ other)
    lags = np.arange(1, max(2, count // 5 + 1))
    alike = float(np.sum((1.0 - lags / count) * own[lags] * others[lags]))
    return float(np.clip(count / max(1.0 + 2.0 * alike, 1.0), 4.0, count))


def chance_of_fit(
    here: PlaceFit,
    others: Sequence[PlaceFit],
    *,
    prior: FloatArray,
    loose: FloatArray,
    center: FloatArray,
) -> float:
    """Chance that noise alike to the residuals here makes another place fit as much better.

    The shots are taken to be right here, and their residuals for noise. Its cosine transform along
    the track gets random signs: what comes of it has the spectrum of the residuals, hence their
    correlation along the track, however short it is, and no relation to the shape. With each such
    noise all places are fitted again, and the best of them is compared with the best of the data.
    A few smooth waves have few signs: residuals that are no more than that leave a large chance.

    Parameters
    ----------
    here : PlaceFit
        Where the shots claim to be.
    others : sequence of PlaceFit
        The same shots at the other places, all those that were searched.
    prior, loose : (8,) ndarray
        Priors of the parameters here, and at the other places.
    center : (8,) ndarray
        About which the prior lies here.

    Returns
    -------
    float
        p-value for all places together, 1/2001 at the least. 0 where nothing is known here, 1
        where nothing is known elsewhere.
    """
    if np.count_nonzero(here.met) < FEWEST_SHOTS:
        return 0.0
    about = PlaceFit(here.met, here.value - here.design @ center, here.design).trimmed(prior)
    rest = about.rest(prior)
    known = rest[about.met]
    # The first is the data as they are.
    noise = np.zeros((len(rest), 1 + _DRAWS))
    noise[about.met] = np.column_stack([known, drawn(known, _DRAWS)])
    least = np.full(1 + _DRAWS, np.inf)
    for other in others:
        if np.count_nonzero(other.met & about.met) >= FEWEST_SHOTS:
            least = np.minimum(least, other.trimmed(loose).squares(loose, noise, rest))
    if not np.isfinite(least[0]):
        return 1.0
    # Not over what a fit here leaves of each: the residuals are what one has left already.
    return float((1 + np.count_nonzero(least[1:] <= least[0])) / (1 + _DRAWS))


def drawn(rest: FloatArray, count: int) -> FloatArray:
    """Noise (N, count) of the spectrum of residuals (N,): their cosine transform, signs drawn."""
    waves = dct(rest, norm="ortho")
    signs = np.random.default_rng(len(rest)).choice([-1.0, 1.0], size=(len(rest), count))
    noise: FloatArray = idct(waves[:, None] * signs, axis=0, norm="ortho")
    return noise
