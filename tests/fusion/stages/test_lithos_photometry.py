"""A photometric function that the images contradict, through the real command line."""

from __future__ import annotations

import shutil

import pytest
from command_line import called

# Maplets that many images show: the mission was rendered with lunar-lambert.
SOME = ("TR0003", "TR0005", "TR0009", "TR0011", "TR0015", "TR0017", "TR0020")


@pytest.fixture(scope="module")
def root(imaged_mission, tmp_path_factory):
    copy = tmp_path_factory.mktemp("photometry") / "WS"
    shutil.copytree(imaged_mission[0], copy, symlinks=True)
    shutil.rmtree(copy / "solutions", ignore_errors=True)
    return copy


def findings(root, *options):
    only = [part for name in SOME for part in ("--only", name)]
    content = called("spc", "lithos", root, *only, "--start", "shape", *options)
    return content["photometry_ratios"], {one["code"]: one for one in content["findings"]}


def test_the_right_function_is_not_doubted(root):
    ratios, found = findings(root, "--as", "right")
    assert set(ratios) == {"lambert", "lommel-seeliger"}
    assert min(ratios.values()) > 1.0
    assert "photometry-doubtful" not in found


def test_a_wrong_function_is_named_with_the_better_one(root):
    ratios, found = findings(root, "--photometry", "lambert", "--as", "wrong")
    assert set(ratios) == {"lunar-lambert", "lommel-seeliger"}
    assert ratios["lunar-lambert"] < 0.95
    doubtful = found["photometry-doubtful"]
    assert len(doubtful["names"]) >= 3
    assert set(doubtful["names"]) <= set(SOME)
    better = min(ratios, key=ratios.get)
    assert f"better with {better}: " in doubtful["do"]


def test_wrong_parameters_of_the_right_function_are_compared_with_those_by_default(root):
    # Nearly Lambert's at all phase angles, where the mission has L = 1 − 0.019 α + … .
    wrong = "lunar-lambert a=-0.2 b=0 c=0"
    ratios, found = findings(root, "--photometry", wrong, "--as", "parameters")
    assert set(ratios) == {"lunar-lambert", "lambert", "lommel-seeliger"}
    assert ratios["lunar-lambert"] < 0.95
    assert "better with l" in found["photometry-doubtful"]["do"]


def test_too_few_maplets_are_not_compared(root):
    content = called("spc", "lithos", root, "--only", "TR0009", "--as", "single")
    assert content["photometry_ratios"] is None
