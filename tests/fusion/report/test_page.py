"""The page: self-contained, complete, honest about what is missing."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.report import make_report
from fusion.report.data import ReportData
from fusion.report.planted import SurfaceErrors

VOID = {"meta", "img", "br", "link"}


class Outline(HTMLParser):
    """Checks that tags nest, and gathers text and links."""

    def __init__(self) -> None:
        super().__init__()
        self.open, self.text, self.targets, self.ids = [], [], [], set()

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.targets += [attrs[key] for key in ("src", "href") if key in attrs]
        self.ids.add(attrs.get("id"))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def page(report_data) -> str:
    return make_report(report_data)


def outline(page: str) -> Outline:
    parsed = Outline()
    parsed.feed(page)
    assert parsed.open == []
    return parsed


def test_needs_nothing_from_outside(page) -> None:
    parsed = outline(page)
    for target in parsed.targets:
        assert target.startswith(("data:image/", "#"))
        if target.startswith("#"):
            assert target[1:] in parsed.ids
    without_images = re.sub(r'src="data:[^"]*"', "", page)
    assert "http" not in without_images
    assert "url(" not in without_images
    assert "<script" not in page
    assert len(page) < 5e6


def test_equal_data_give_equal_pages(report_data) -> None:
    part = replace(report_data, surfaces=(), registration=None)
    assert make_report(part) == make_report(part)


def test_shows_every_part(page) -> None:
    text = " ".join(outline(page).text)
    for wanted in (
        "Bennu <test>", "BE0012", "largest lidar coverage", "213", "0.01050", "−0.0024",
        "disagrees with the rest", "coverage < 0.3", "142", "0.0348", "within 20° of the equator",
        "5.45",
    ):  # fmt: skip
        assert wanted in text, wanted
    assert page.count("<img") == 5


def test_planted_that_is_not_recovered_stands_out(page) -> None:
    assert page.count('<td class="off">') == 1
    assert '<td class="off">5.45' in page


def test_large_pulls_are_explained_and_surfaces_are_compared_with_the_truth(report_data) -> None:
    *rest, off = report_data.planted
    planted = (*rest, replace(off, explanation="<half> of it is planted"))
    errors = (
        SurfaceErrors("SPC", 0.964, 0.172, 0.476, 0.2331),
        SurfaceErrors("both", 1.0, 0.035, 0.2, 0.069),
    )
    data = replace(
        report_data, surfaces=(), registration=None, scale=None, planted=planted, errors=errors
    )
    text = " ".join(outline(make_report(data)).text)
    assert "translation x: <half> of it is planted" in text
    for wanted in ("Beyond 3 sigma", "96 %", "0.233", "100 %", "0.069"):
        assert wanted in text, wanted
    assert "Beyond 3 sigma" not in make_report(replace(data, planted=report_data.planted))


def test_missing_parts_are_stated_as_missing() -> None:
    text = " ".join(outline(make_report(ReportData())).text)
    for wanted in ("no fused maplets", "no maplets or mapolas", "no registration", "no scale"):
        assert wanted in text
    assert "Planted" not in text


def test_sparse_results_are_shown_too(report_data) -> None:
    registration = {
        **report_data.registration, "scale_sigma": None, "residual_std_m": [None, None, None],
        "per_mapola": [
            {**entry, "used": False, "residual_m": [None] * 3, "reason": "no <lidar>"}
            for entry in report_data.registration["per_mapola"][:2]
        ],
    }  # fmt: skip
    scale = {"epsilon": None, "epsilon_sigma": None, "per_day": [], "per_pair": [], "reasons": []}
    page = make_report(ReportData("B", registration=registration, scale=scale))
    text = " ".join(outline(page).text)
    assert "no <lidar>" in text
    one = {"day": "2019-03-07", "n": 1, "epsilon": 1e-4, "epsilon_sigma": None}
    pair = {"epsilon": 1e-4, "longitude_deg": 5.0, "local_time_h": None, "used": True}
    scale |= {"epsilon": 1e-4, "per_day": [one], "per_pair": [pair]}
    shown = outline(make_report(ReportData("B", scale=scale)))
    assert sum(target.startswith("data:image/") for target in shown.targets) == 1


def test_empty_surfaces_do_not_stop_the_report(places) -> None:
    place = places[0]
    nothing = np.full(place.fused.grid.shape, np.nan)
    empty = type(place)(place.fused, nothing, nothing, "no SPC, no lidar")
    shown = outline(make_report(ReportData("B", surfaces=(empty,))))
    assert place.fused.name in " ".join(shown.text)
    assert sum(target.startswith("data:image/") for target in shown.targets) == 1


def test_checks_of_the_registration_and_what_it_hardly_determines_are_shown(report_data, page):
    registration = {
        **report_data.registration,
        "tests": {
            "strain": {"chi2": 31.2, "degrees_of_freedom": 5, "p_value": 8.6e-6, "reason": ""},
            "scale": {
                "chi2": None,
                "degrees_of_freedom": 1,
                "p_value": None,
                "reason": "one <cap>",
            },
        },
        "stability": {"suspect_regions": ["longitude 20, latitude -40"]},
        "reasons": ["rz_rad: weakly determined"],
    }
    checked = make_report(replace(report_data, surfaces=(), registration=registration))
    for wanted in (
        "shear and non-uniform scale", "31.2 of 5", "9e-06", "one &lt;cap&gt;",
        "longitude 20, latitude -40", "Weakly determined", "rz_rad: weakly determined",
    ):  # fmt: skip
        assert wanted in checked
    assert "Checks" not in page


def test_what_speaks_against_a_result_stands_before_all_else(report_data) -> None:
    grave = Finding(Code.STRAIN, Severity.DOUBTFUL, "sheared by <b>")
    note = Finding(Code.WEAKLY_DETERMINED, Severity.NOTE, "weak")
    fits = Finding(Code.FITS_OTHERWISE, Severity.NOTE, "fits when turned")
    verdicts = {"register": Verdict((grave, note, fits)), "scale": Verdict()}
    data = replace(report_data, surfaces=(), registration=None, verdicts=verdicts)
    page = make_report(data)
    box = page[page.index('<div class="verdict doubtful">') : page.index("<section")]
    assert "register: doubtful" in box
    assert "scale: accepted" in box
    assert "sheared by &lt;b&gt; <code>[strain]</code>" in box
    assert "weak" not in box
    assert "fits when turned" in box
    accepted = make_report(replace(data, accepted=("strain",)))
    assert "[strain, accepted]" in accepted
