"""Images and maplets that fit far worse than the others are named, and no others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusion.stages.lithos.outliers import outlier_findings
from fusion.stages.lithos.result import LithosResult
from spcola.photometry.photoclinometry import Fit, ImageFit

RNG = np.random.default_rng(3)


@pytest.fixture
def fits() -> dict[str, list[ImageFit]]:
    """Twelve maplets, each in ten of fourteen images: noise of 1 to 4 %, shifts of 0.1 px."""
    noise = RNG.uniform(0.01, 0.04, 14)
    found = {}
    for number in range(12):
        images = RNG.choice(14, 10, replace=False)
        found[f"AA{number:04d}"] = [
            ImageFit(
                f"I{k:02d}", Fit.USED, 2e4, tuple(RNG.normal(0, 0.1, 2)),
                noise[k] * RNG.uniform(1.0, 1.3), 0.95, 900, (0.0, 0.0), noise[k], 0.3,
            )
            for k in images
        ]  # fmt: skip
    return found


def changed(fits, change, *, image="", maplet=""):
    """The fits of an image or a maplet, changed."""
    return {
        name: [change(fit) if image == fit.name or maplet == name else fit for fit in ones]
        for name, ones in fits.items()
    }


def codes(fits):
    return {one["code"]: one["names"] for one in outlier_findings(fits)}


def test_nothing_is_named_where_all_fit_alike(fits):
    assert codes(fits) == {}


def test_residuals_far_from_the_others_are_named_and_noise_is_not(fits):
    def more(fit):
        return replace(fit, residual=4.0 * fit.residual)

    def noisy(fit):
        return replace(fit, residual=4.0 * fit.residual, noise=4.0 * fit.noise)

    assert codes(changed(fits, more, image="I03")) == {"image-residual": ["I03"]}
    assert codes(changed(fits, more, maplet="AA0007")) == {"maplet-residual": ["AA0007"]}
    assert codes(changed(fits, noisy, image="I03")) == {}


def test_shifts_far_from_the_others_are_named(fits):
    def displaced(fit):
        return replace(fit, shift_px=(1.5, -1.0))

    assert codes(changed(fits, displaced, image="I05")) == {"image-shift": ["I05"]}
    assert codes(changed(fits, displaced, maplet="AA0002")) == {"maplet-shift": ["AA0002"]}
    tiny = {name: [replace(f, shift_px=(0.001, 0.0)) for f in ones] for name, ones in fits.items()}
    little = changed(tiny, lambda fit: replace(fit, shift_px=(0.2, 0.0)), image="I05")
    assert codes(little) == {}


def test_an_image_is_not_blamed_for_the_maplets_that_it_shows(fits):
    # All images of three maplets fit badly there; I13 shows only these.
    bad = ("AA0000", "AA0001", "AA0002")
    found = {
        name: [
            replace(fit, residual=5.0 * fit.residual) if name in bad else fit
            for fit in ones
            if name in bad or fit.name != "I13"
        ]
        for name, ones in fits.items()
    }
    assert set(codes(found)) == {"maplet-residual"}
    assert sorted(codes(found)["maplet-residual"]) == list(bad)


def test_an_image_of_other_relief_is_named_also_where_a_single_maplet_shows_it(fits):
    # Its noise contains the relief that the surface lacks, so that the ratio to it is usual.
    def other(pixels, correlation):
        usual = float(np.median([fit.residual for fit in fits["AA0000"]]))
        made = replace(
            fits["AA0000"][0], name="I99", residual=8.0 * usual, noise=7.0 * usual, pixels=pixels,
            correlation=correlation,
        )  # fmt: skip
        return {**fits, "AA0000": [*fits["AA0000"], made]}

    assert codes(other(1500, 0.5)) == {"image-residual": ["I99"]}
    assert codes(other(500, 0.5)) == codes(other(1500, 0.7)) == {}


def test_few_are_not_compared(fits):
    few = {name: ones[:3] for name, ones in list(fits.items())[:3]}
    assert codes(few) == {}


@pytest.mark.parametrize(("sigmas", "shown"), [([2.0, None, 4.0], "3.000 m"), ([None], "unknown")])
def test_maplets_that_keep_a_start_without_sigma_are_printed(sigmas, shown):
    maplets = {
        f"AA{k:04d}": {"rounds": [{}], "residual_start": 0.2, "residual": 0.1, "sigma_m": sigma}
        for k, sigma in enumerate(sigmas)
    }
    content = {
        "options": {},
        "maplets": maplets,
        "images": {},
        "outcomes": {"diverged": 1},
        "findings": [],
    }
    result = LithosResult("new", "old", Path("body/solutions/new"), content)
    assert any(f"sigma of heights {shown} (medians)" in line for line in result.lines())


@pytest.mark.parametrize("unknown", [None, float("nan")])
def test_maplets_whose_start_images_did_not_show_are_printed(unknown):
    maplets = {
        name: {"rounds": [{}], "residual_start": start, "residual": 0.1, "sigma_m": 0.3}
        for name, start in (("AA0001", 0.2), ("AA0002", unknown))
    }
    content = {
        "options": {},
        "maplets": maplets,
        "images": {},
        "outcomes": {"converged": 2},
        "findings": [],
    }
    lines = LithosResult("new", "old", Path("body/solutions/new"), content).lines()
    assert any("residual of brightness 20.0% → 10.0%" in line for line in lines)


def test_among_few_images_one_that_is_far_off_is_named(fits):
    """Five images of one maplet: of so few no scatter is known."""
    five = {"AA0000": fits["AA0000"][:5]}
    assert codes(five) == {}
    other = five["AA0000"][2]

    def times(factor):
        return changed(
            five, lambda fit: replace(fit, residual=factor * fit.residual), image=other.name
        )

    assert codes(times(2.0)) == {}
    assert codes(times(6.0)) == {"image-residual": [other.name]}
    assert codes({"AA0000": times(6.0)["AA0000"][1:4]}) == {}
