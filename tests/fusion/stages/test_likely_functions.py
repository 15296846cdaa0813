"""Photometric functions that images do not distinguish, in sigmas of maplets from images."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, called, refused

from fusion.stages.lithos.likely_functions import photometry_path, with_likely_functions
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.photometry.functions import photometric_function
from spcola.photometry.photoclinometry import PhotoclinometryOptions

MAPLET = "TR0009"
OPTIONS = PhotoclinometryOptions(function=photometric_function("minnaert k=0.6 k_slope=0.001"))
COVARIANCE = [[0.01, 0.0], [0.0, 1e-6]]


@pytest.fixture(scope="module")
def root(imaged_mission, tmp_path_factory):
    copy = tmp_path_factory.mktemp("likely") / "WS"
    shutil.copytree(imaged_mission[0], copy, symlinks=True)
    shutil.rmtree(copy / "solutions", ignore_errors=True)
    (copy / "photometry.json").unlink(missing_ok=True)
    return copy


def entry(setting, *, as_good=True, covariance=()):
    """A function as photometry.json has it."""
    function = photometric_function(setting)
    named = zip(function.parameters, function.values, strict=True)
    parameters = {one.name: {"value": value} for one, value in named} if len(covariance) else {}
    return {
        "name": function.name, "setting": setting, "as_good": as_good, "parameters": parameters,
        "covariance": [list(row) for row in covariance],
    }  # fmt: skip


def fitted(root, *functions, preferred="minnaert"):
    """A workspace in which these functions were fitted."""
    content = {"filters": [{"preferred": preferred, "functions": list(functions)}]}
    (root / "photometry.json").write_text(json.dumps(content))
    return Workspace.open(root)


def others(workspace, options=OPTIONS):
    found = with_likely_functions(options, workspace).other_functions or ()
    return [(one.text, weight) for one, weight in found]


def test_without_a_fit_no_other_function_is_known(root):
    assert with_likely_functions(OPTIONS, Workspace.open(root)).other_functions is None
    assert photometry_path(Workspace.open(root)) is None


@pytest.fixture
def place(tmp_path):
    (tmp_path / "spcola.toml").write_text('[body]\nname = "Waves"\n')
    return tmp_path


def test_functions_as_good_share_their_weight_and_worse_ones_have_none(place):
    own = entry("minnaert k=0.6 k_slope=0.001")
    workspace = fitted(place, own, entry("akimov"), entry("lambert", as_good=False))
    assert others(workspace) == [("akimov", 0.5)]
    assert with_likely_functions(OPTIONS, fitted(place, own)).other_functions == ()
    # Another one in use: the preferred one may be right too, and the same one counts once.
    again = replace(OPTIONS, function=photometric_function("lommel-seeliger"))
    workspace = fitted(place, own, entry("akimov"), entry("akimov"))
    third = pytest.approx(1.0 / 3.0)
    assert others(workspace, again) == [("minnaert k=0.6 k_slope=0.001", third), ("akimov", third)]


def test_parameters_of_the_one_in_use_are_a_sigma_off_within_their_bounds(place):
    workspace = fitted(place, entry("minnaert k=0.6 k_slope=0.001", covariance=COVARIANCE))
    found = with_likely_functions(OPTIONS, workspace).other_functions
    assert [weight for _, weight in found] == [1.0, 1.0]
    off = np.abs([np.subtract(one.values, OPTIONS.function.values) for one, _ in found])
    np.testing.assert_allclose(off.sum(axis=0), [0.1, 0.001], rtol=1e-6)
    # Far off, or not determined at all (null is NaN): to the bound that is farther away.
    for variance in (9.0, None):
        covariance = [[variance, 0.0], [0.0, 1e-6]]
        far = fitted(place, entry("minnaert k=0.6 k_slope=0.001", covariance=covariance))
        values = [one.values[0] for one, _ in with_likely_functions(OPTIONS, far).other_functions]
        assert sorted(values) == pytest.approx([0.6, 2.0]), variance
    # Of correlated parameters the sum of the squares of what both axes change is the covariance.
    correlated = [[0.01, 8e-5], [8e-5, 1e-6]]
    workspace = fitted(place, entry("minnaert k=0.6 k_slope=0.001", covariance=correlated))
    found = with_likely_functions(OPTIONS, workspace).other_functions
    steps = np.array([np.subtract(one.values, OPTIONS.function.values) for one, _ in found])
    np.testing.assert_allclose(steps.T @ steps, correlated, rtol=1e-6)


def test_a_damaged_fit_is_refused_in_one_line(root):
    path = root / "photometry.json"
    path.write_text('{"filters": [{"preferred": "akimov"}]}')
    line = refused("spc", "lithos", root, "--only", MAPLET)
    assert "photometry.json" in line
    assert "fit the functions again: spcola photometry fit" in line
    path.unlink()


def test_sigmas_of_a_solution_grow_by_what_as_good_functions_change(root):
    run = "spc", "lithos", root, "--only", MAPLET, "--start", "shape"
    before = called(*run, "--as", "known")
    assert before["options"]["other_photometry"] is None
    lacking = "  sigmas lack errors of the photometric function: spcola photometry fit finds them"
    assert lacking in call(*run, "--as", "printed").stdout.splitlines()
    fitted(root, entry("lunar-lambert", covariance=()), entry("lunar-lambert-exponential"),
           preferred="lunar-lambert")  # fmt: skip
    after = called(*run, "--as", "likely")
    assert after["options"]["other_photometry"] == {"lunar-lambert-exponential alpha0=60": 0.5}
    one, other = (content["maplets"][MAPLET] for content in (before, after))
    for key in ("sigma_m", "slope_sigma", "albedo_sigma"):
        assert other[key] > one[key], key
    for key in ("residual", "rounds", "outcome"):
        assert other[key] == one[key]
    first, second = (Workspace.open(root, name).maplet(MAPLET) for name in ("known", "likely"))
    np.testing.assert_array_equal(first.height, second.height)
    assert "photometry.json" in read_solution(root, "likely").digests
    # What was fitted before a solution was made holds for it too.
    assert lacking not in call(*run, "--as", "again").stdout.splitlines()
    made = Workspace.open(root, "likely")
    assert photometry_path(made) == root / "photometry.json"
