"""The body in a real browser: turning, values, squares and links."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from ball import RADIUS
from page_views import ready, serious, worth_a_look
from playwright.sync_api import expect


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a workspace that has a shape."""
    root = tmp_path_factory.mktemp("body")
    worth_a_look(root / "ball")
    return root


def middle(page: Any) -> tuple[float, float]:
    box = page.get_by_role("application").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def read(page: Any) -> dict[str, float]:
    """Return the numbers of the line that says what lies under the pointer."""
    text = page.locator(".readout").inner_text().replace("−", "-")
    return {name: float(value) for name, value in re.findall(r"([a-z]+) (-?[\d.]+)", text)}


def test_the_pointer_reads_place_and_value(page: Any) -> None:
    # The square AA0001 lies at a longitude of 0.5 rad; its sigma is 0.04 m.
    ready(page, "/ball/body?layer=sigma&camera=28.65,0,60&outlines=fused")
    page.mouse.move(*middle(page))
    expect(page.locator(".readout")).to_contain_text("fused AA0001")
    found = read(page)
    assert found["longitude"] == pytest.approx(28.65, abs=0.2)
    assert found["latitude"] == pytest.approx(0.0, abs=0.2)
    assert found["radius"] == pytest.approx(RADIUS, rel=0.01)
    assert page.locator(".readout").inner_text().count("sigma 40.0") + (found.get("sigma") == 0.04)
    # 20 m further no surface is known, and no value is invented.
    x, y = middle(page)
    height = page.get_by_role("application").bounding_box()["height"]
    page.mouse.move(x, y - 20.0 * height / 60.0)
    expect(page.locator(".readout")).to_contain_text("sigma unknown")


def test_keys_turn_and_a_link_restores_the_view(page: Any) -> None:
    ready(page, "/ball/body?camera=100,10,90&layer=difference&light=30,20&outlines=none")
    page.get_by_role("application").focus()
    for key in ("ArrowRight", "ArrowUp", "Shift+ArrowUp", "+"):
        page.keyboard.press(key)
    page.wait_for_url(re.compile("camera=105.00%2C16.00%2C72.00"))
    link = page.url.partition("#")[2]
    ready(page, link)
    expect(page.locator(".readout")).to_contain_text("longitude 105.00° E")
    expect(page.locator("select[name=layer]")).to_have_value("difference")
    expect(page.get_by_label("Sun stays above a place")).to_be_checked()
    page.wait_for_timeout(400)
    assert page.url.partition("#")[2] == link


def test_a_square_leads_to_its_map(page: Any) -> None:
    ready(page, "/ball/body?camera=28.65,0,60&outlines=fused")
    expect(page.locator("#squares option")).to_have_count(3)
    page.mouse.click(*middle(page))
    page.wait_for_url(re.compile("/map/fused/AA0001"))
    ready(page, "/ball/body?outlines=maplet")
    page.locator("input[name=square]").fill("AA0002")
    page.get_by_role("button", name="Open map").click()
    page.wait_for_url(re.compile("/map/maplet/AA0002"))


def test_the_body_is_accessible(page: Any) -> None:
    ready(page, "/ball/body?layer=source&light=10,10")
    assert not serious(page)
