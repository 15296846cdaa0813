"""Acceptance tests of the scale by its own data: findings of the stage `scale`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from fusion.estimation.verdict import Code, Finding, Severity
from fusion.scaling.fit.joint import ScaleEstimate, ScaleOptions
from fusion.scaling.fit.observation import PARAMETERS, ScaleObservations
from fusion.scaling.fit.residuals import after_fit
from fusion.scaling.misplacement.check import FALSE_ALARM, PlaceCheck
from fusion.scaling.misplacement.crossings import Crossings
from fusion.scaling.misplacement.scans import ScanChecks
from spcola.math.robust import mad

SIGNIFICANT = 3.0
"""Smallest |ε| in its sigmas for ε to be applied."""

BEYOND = 3.5
"""Largest distance of a parameter from 0 in prior sigmas: kept by all eight in 99.6 % of runs."""

TOO_LARGE = 20.0
"""Largest ratio of scatter to its expectation: three widths of its prior, exp(3)."""

REJECTED = 0.2
"""Largest share of pairs or shots rejected."""

MISPLACED = 0.5
"""Share of scans that fit better elsewhere above which a result is refused; one: doubtful."""

CROSSING = 2.0
"""Largest ratio of differences between scans over the same ground to those within one scan."""

MISSED = 1.0 / 3.0
"""Largest share of shots that miss the shape or graze it."""

UNMATCHED = 0.5
"""Largest share of pairs of surfaces without match."""

CHANCE = 1e-4
"""p-value below which days, or the scales of pairs and of the registration, disagree."""

MOVED = 0.3
"""Largest change, in sigmas, in the last round of an estimate that has not converged."""

# A scatter of more than this many times the expected one is noted; with a smaller one a fit as good
# as at wrong places is only noted.
_EXPECTED = 3.0
# Number of scans named in a finding.
_NAMED = 3

_GROUPS = (
    (Code.EPSILON_BEYOND_PRIOR, "epsilon", slice(0, 1), 1.0, ""),
    (Code.CENTRE_BEYOND_PRIOR, "the centre", slice(1, 4), 1.0, " m"),
    (Code.POLE_BEYOND_PRIOR, "the pole", slice(4, 6), 180.0 / np.pi, " deg"),
    (Code.MERIDIAN_BEYOND_PRIOR, "the prime meridian", slice(6, 7), 180.0 / np.pi, " deg"),
    (Code.RANGE_BIAS_BEYOND_PRIOR, "the range bias", slice(7, 8), 1.0, " m"),
)


def scale_findings(
    observations: ScaleObservations, estimate: ScaleEstimate, options: ScaleOptions
) -> list[Finding]:
    """Test an estimate from observations by its convergence, its residuals and its priors.

    Findings are doubtful if the result may be wrong or meaningless; a weakly determined term is
    only a note, as its sigma includes that.
    """
    return [
        *_of_the_fit(observations, estimate, options),
        *_of_priors(estimate, options),
        *_weak_terms(estimate, options),
    ]


def _of_the_fit(
    observations: ScaleObservations, estimate: ScaleEstimate, options: ScaleOptions
) -> list[Finding]:
    """Test convergence, rejections, scatter and agreement of days."""
    fit, found = estimate.fit, []
    if not fit.converged:
        text = (
            f"the fit did not converge: {fit.reason}; the last round changed the estimate by "
            f"{fit.moved:.2g} of its sigmas"
        )
        # One pair at the limit of rejection may alternate without effect on the result.
        make = _doubtful if fit.moved > MOVED else _note
        found.append(make(Code.SCALE_NOT_CONVERGED, text, fit.moved, MOVED))
    share = float(np.mean(~fit.used))
    if share > REJECTED:
        text = f"{share:.0%} of the {observations.kind} disagree with the rest and were rejected"
        found.append(_doubtful(Code.MANY_REJECTED, text, share, REJECTED))
    # With many outliers the fitted single error grows, which the robust scatter does not show.
    rest = max(float(mad(after_fit(observations, fit))), fit.sizes.independent)
    expected = expected_scatter(observations, options)
    if rest > _EXPECTED * expected:
        text = (
            f"residuals scatter by {rest:.3g} m where {expected:.3g} m are expected from "
            "stated sigmas, [scale] single_sigma_m and state_sigma_m"
        )
        # Errors of a coarse shape are ten times as large, and not in any stated sigma.
        doubtful = rest > TOO_LARGE * expected
        make, limit = (_doubtful, TOO_LARGE) if doubtful else (_note, _EXPECTED)
        found.append(make(Code.SCATTER_TOO_LARGE, text, rest, limit * expected))
    if estimate.days_p_value < CHANCE:
        text = (
            "ranges of single days differ by more than their sigmas and [scale] day_sigma_m "
            f"(p = {estimate.days_p_value:.1e})"
        )
        found.append(_doubtful(Code.DAYS_DISAGREE, text, estimate.days_p_value, CHANCE))
    return found


def expected_scatter(observations: ScaleObservations, options: ScaleOptions) -> float:
    """Expected standard deviation of range residuals from stated sigmas and settings, metres."""
    own = float(np.median(observations.range_variance))
    states = options.state_sigma_m if observations.trajectory == "spc" else 0.0
    return float(np.sqrt(own + options.single_sigma_m**2 + states**2))


def _of_priors(estimate: ScaleEstimate, options: ScaleOptions) -> list[Finding]:
    """Test parameters against their priors."""
    off = np.abs(estimate.fit.estimate) / options.prior
    found = []
    for code, name, part, unit, of in _GROUPS:
        worst = int(np.argmax(off[part])) + part.start
        if off[worst] > BEYOND:
            text = (
                f"{name} comes out at {unit * estimate.fit.estimate[worst]:.3g}{of}, "
                f"{off[worst]:.1f} sigma of its prior ({unit * options.prior[worst]:.3g}{of})"
            )
            found.append(_doubtful(code, text, float(off[worst]), BEYOND))
    return found


def _weak_terms(estimate: ScaleEstimate, options: ScaleOptions) -> list[Finding]:
    """Note terms that the data do not determine or do not separate from ε."""
    left, found = estimate.undetermined(options), []
    ratio = abs(estimate.epsilon) / estimate.epsilon_sigma
    if PARAMETERS[0] in left:
        text = (
            f"epsilon is not determined by the data: its sigma {estimate.epsilon_sigma:.2g} is "
            f"that of its prior ({options.epsilon_prior:.2g})"
        )
        found.append(_note(Code.EPSILON_NOT_DETERMINED, text))
    for name, correlation in estimate.inseparable:
        text = f"epsilon is not separable from {name} (correlation {correlation:+.3f})"
        found.append(_note(Code.EPSILON_NOT_SEPARABLE, text, correlation))
    if ratio < SIGNIFICANT:
        text = (
            f"epsilon {estimate.epsilon:.2g} is {ratio:.1f} of its sigmas "
            f"({estimate.epsilon_sigma:.2g})"
        )
        found.append(_note(Code.EPSILON_NOT_SIGNIFICANT, text, ratio, SIGNIFICANT))
    others = [name for name in left if name != PARAMETERS[0]]
    if others:
        text = f"determined by their priors: {', '.join(others)}"
        found.append(_note(Code.TERMS_FROM_PRIOR, text))
    return found


def place_findings(check: PlaceCheck, scatter_m: float) -> list[Finding]:
    """Test whether shots fit the shape better elsewhere, or as well at wrong places.

    `scatter_m` is the expected scatter of the residuals, metres. On ground without relief shots fit
    everywhere with this scatter, which is only noted.
    """
    found = []
    if check.misfit:
        text = (
            f"the shots fit better when {check.best}: they scatter by {check.best_m:.2f} m instead "
            f"of {check.here_m:.2f} m (p = {check.p_value:.1e} over {check.tried} places)"
        )
        found.append(
            Finding(Code.SHOTS_FIT_ELSEWHERE, Severity.REFUSED, text, check.p_value, FALSE_ALARM)
        )
    if check.by_chance:
        text = (
            f"the shots fit no better than at wrong places: the scatter of {check.here_m:.2f} m is "
            f"reached at {check.as_good} of {check.wrong} (turned by more than 20 deg or mirrored)"
        )
        plain = check.here_m <= _EXPECTED * scatter_m
        make = _note if plain else _doubtful
        found.append(make(Code.SHOTS_FIT_BY_CHANCE, text, float(check.as_good), 0.0))
    return found


def scan_findings(places: ScanChecks, crossings: Crossings) -> list[Finding]:
    """Test whether single scans fit better elsewhere, and whether scans agree.

    The result is refused if more than half of the scans fit better elsewhere.
    """
    found, count = [], len(places.checks)
    wrongly = [
        f"{', '.join(names)} when {check.best} ({check.best_m:.2f} m instead of "
        f"{check.here_m:.2f} m)"
        for names, check, wrong in zip(places.names, places.checks, places.misfits, strict=True)
        if wrong
    ]
    if wrongly:
        more = len(wrongly) - _NAMED
        text = (
            f"{len(wrongly)} of {count} scans (or groups of scans) fit better turned or mirrored, "
            f"each on its own: {'; '.join(wrongly[:_NAMED])}"
            + (f"; {more} more in scan_check" if more > 0 else "")
        )
        severity = Severity.REFUSED if len(wrongly) > MISPLACED * count else Severity.DOUBTFUL
        value = len(wrongly) / count
        found.append(Finding(Code.SCANS_FIT_ELSEWHERE, severity, text, value, MISPLACED))
    ratio = crossings.between_m / max(crossings.within_m, 1e-6)
    if ratio > CROSSING:
        text = (
            f"shots of different scans within {crossings.apart_m:.3g} m differ by "
            f"{crossings.between_m:.3g} m, those of one scan by {crossings.within_m:.3g} m: "
            "errors of the shape would be common to both"
        )
        found.append(_doubtful(Code.SCANS_DISAGREE, text, ratio, CROSSING))
    return found


def lost_findings(kind: Literal["pairs", "shots"], lost: int, count: int) -> list[Finding]:
    """Test the number, of `count`, of shots that miss the shape or of pairs without match."""
    if kind == "shots":
        code, limit = Code.SHOTS_MISS_SHAPE, MISSED
        what = "shots miss the shape, graze it, or have no spacecraft position"
    else:
        code, limit = Code.PAIRS_NOT_MATCHED, UNMATCHED
        what = "pairs of surfaces could not be matched; see per_pair"
    share = lost / max(count, 1)
    if share <= limit:
        return []
    return [_doubtful(code, f"{lost} of {count} {what}", share, limit)]


def consistency_findings(compared: Mapping[str, Any]) -> list[Finding]:
    """Test whether ε and the scale of the registration agree."""
    p_value = compared["p_value"]
    # The p-value is NaN if both scales have sigma 0.
    if p_value is None or not p_value < CHANCE:
        return []
    text = (
        f"(1 + epsilon) times the scale of the registration differs from 1 by "
        f"{compared['difference']:.2g}, {abs(compared['z']):.1f} of its sigmas"
    )
    return [_doubtful(Code.SCALES_INCONSISTENT, text, p_value, CHANCE)]


def _doubtful(
    code: Code, text: str, value: float | None = None, limit: float | None = None
) -> Finding:
    return Finding(code, Severity.DOUBTFUL, text, value, limit)


def _note(code: Code, text: str, value: float | None = None, limit: float | None = None) -> Finding:
    return Finding(code, Severity.NOTE, text, value, limit)
