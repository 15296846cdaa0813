"""Maplets from images in a real browser: goodness of fit, sorted, and a maplet with its images."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from page_views import ready, serious
from playwright.sync_api import expect
from solved_workspace import FAR, MAPLET, REVERSED

from fusion.workspace import Workspace


@pytest.fixture(scope="module")
def folder(solved: tuple[Path, dict], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the workspace `waves`."""
    root = tmp_path_factory.mktemp("page")
    shutil.copytree(solved[0], root / "waves", symlinks=True)
    # Too few maplets are there to compare photometric functions.
    workspace = Workspace.open(root / "waves")
    content = workspace.read_json("photoclinometry.json")
    content["photometry_ratios"] = {"lunar-lambert": 0.968, "lommel-seeliger": 1.25}
    workspace.photoclinometry_path.unlink()
    workspace.write_json("photoclinometry.json", content)
    return root


def test_the_index_sorts_and_names_outliers(page: Any) -> None:
    ready(page, "/waves/photoclinometry")
    expect(page.get_by_role("list", name="Findings")).to_contain_text(f"sun-reversed {REVERSED}")
    images = page.get_by_role("region", name="Goodness of fit of images")
    names = images.locator("tbody td:first-child")
    expect(names.first).to_have_text(REVERSED)
    images.get_by_role("button", name="Image").click()
    expect(names).to_have_text(["I0", "I1", "I2", "I3", REVERSED])
    expect(images.locator("thead")).to_contain_text("Sun reversed")
    expect(page.locator("main")).to_contain_text("photometric functionlambert")
    expect(page.locator("main")).to_contain_text("lommel-seeliger 1.25, lunar-lambert 0.97")
    maplets = page.get_by_role("region", name="Goodness of fit of maplets")
    expect(maplets).to_contain_text("too-few-images")
    assert not serious(page)
    maplets.get_by_role("link", name=MAPLET).click()
    expect(page.locator("h1")).to_have_text(MAPLET)


def test_a_maplet_has_its_images_and_their_renderings(page: Any) -> None:
    ready(page, f"/waves/photoclinometry/{MAPLET}?solution=images")
    strips = page.locator(".strips img")
    expect(strips).to_have_count(5)
    sizes = strips.evaluate_all("all => all.map(one => [one.naturalWidth, one.naturalHeight])")
    assert sizes == [[3 * 41 + 4, 41]] * 5
    expect(page.locator(".strips figcaption").first).to_contain_text(f"{REVERSED} sun-reversed")
    titles = page.locator(".tiles h2")
    expect(titles).to_have_text(["Hill-shade", "Albedo", "Sigma", "Directions of slopes"])
    legend = page.get_by_role("list", name="Directions in which images determine the slope")
    expect(legend.get_by_role("listitem")).to_have_text(["none", "one", "two"])
    tops = page.locator(".tiles img").evaluate_all(
        "all => all.map(one => one.getBoundingClientRect().top)"
    )
    assert len(set(tops)) == 1
    expect(page.locator(".plots canvas")).to_have_count(2)
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        assert not serious(page)
    page.set_viewport_size({"width": 820, "height": 1180})
    assert page.evaluate("document.documentElement.scrollWidth") <= 820
    ready(page, f"/waves/photoclinometry/{FAR}")
    expect(page.locator("main")).to_contain_text("There was no round")


def test_without_such_a_solution_it_says_what_makes_one(page: Any) -> None:
    page.route(
        "**/solutions",
        lambda route: route.fulfill(json={"in_use": "imported", "solutions": [], "problems": []}),
    )
    ready(page, "/waves/photoclinometry")
    expect(page.get_by_role("link", name="a job")).to_have_attribute(
        "href", "#/waves/jobs/new/spc-lithos"
    )
