"""Sigmas that contain what another photometric function would change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from solved_photographs import FEW_ROUNDS, solved_flat

from spcola.photometry.functions import lambert, photometric_function
from spcola.photometry.photoclinometry.surface import cell_slopes

# The photographs are Lambert's; this one darkens towards the limb half as much.
WRONG = photometric_function("minnaert k=0.75 k_slope=0")
EDGE = 4


def inner(layer):
    return layer[..., EDGE:-EDGE, EDGE:-EDGE]


def rms_pull(wrong, sigma):
    return float(np.sqrt(np.nanmean(inner(wrong / sigma) ** 2)))


@pytest.fixture(scope="module")
def found(painted, photographs):
    """Solved with a wrong function: as if it was known, and with the right one as likely."""
    options = replace(FEW_ROUNDS, function=WRONG)
    known = solved_flat(painted, photographs, options)
    likely = replace(options, other_functions=((lambert, 0.5),))
    return known, solved_flat(painted, photographs, likely)


def test_the_truth_with_the_other_function_lies_within_the_sigmas(painted, found):
    """Two functions that are equally likely: with the wrong one errors are √2 sigma at most."""
    known, likely = found
    np.testing.assert_array_equal(known.maplet.height, likely.maplet.height)
    np.testing.assert_array_equal(known.maplet.albedo, likely.maplet.albedo)
    wrong = likely.maplet.height - painted.heights()
    slopes = cell_slopes(wrong, painted.grid.gsd)
    assert rms_pull(wrong, known.maplet.sigma) > 2.5
    assert rms_pull(slopes, known.slope_sigma) > 2.5
    assert 1.0 < rms_pull(wrong, likely.maplet.sigma) < 1.5
    assert 1.0 < rms_pull(slopes, likely.slope_sigma) < 1.5


def test_squares_are_those_of_a_whole_solution_with_the_other_function(photographs, painted, found):
    known, likely = found
    other = solved_flat(painted, photographs, replace(FEW_ROUNDS, function=lambert))
    changes = inner(other.maplet.height - known.maplet.height)
    added = inner(likely.maplet.sigma**2 - known.maplet.sigma**2)
    assert np.sqrt(2.0 * np.mean(added)) == pytest.approx(np.sqrt(np.mean(changes**2)), rel=0.05)
    more = likely.albedo_sigma - known.albedo_sigma
    assert np.nanmin(more) >= 0.0
    assert np.nanmax(more) > 0.01


def test_the_function_itself_as_another_one_adds_nothing(painted, photographs, found):
    options = replace(FEW_ROUNDS, function=WRONG, other_functions=((WRONG, 1.0),))
    same = solved_flat(painted, photographs, options)
    np.testing.assert_array_equal(same.maplet.sigma, found[0].maplet.sigma)
    np.testing.assert_array_equal(same.slope_sigma, found[0].slope_sigma)
    np.testing.assert_array_equal(same.albedo_sigma, found[0].albedo_sigma)
