"""Every view in a real browser: it shows, nothing fails in it, and axe finds nothing serious."""

from __future__ import annotations

from typing import Any

from page_views import serious
from playwright.sync_api import expect

VIEWS = {
    "/": "Workspaces",
    "/-/tokens": "Tokens",
    "/-/audit": "Audit log",
    "/ball/overview?list=maplets&show=returns,mapolas,images": "ball",
    "/ball/solutions": "Solutions",
    "/ball/jobs": "Jobs",
    "/ball/jobs/new": "New run",
    "/ball/jobs/new/others": "Other jobs",
    "/ball/jobs/new/images": "Import images",
    "/ball/jobs/uploads": "Uploads",
    "/ball/jobs/outputs": "Outputs",
    "/ball/products": "Products",
    "/ball/runs": "Runs",
    "/ball/runs/imported:mapolas": "Run imported:mapolas",
    "/ball/runs/provenance?product=mapolas/AA0001.MAP": "Provenance",
}
"""Addresses of views, and their headings."""


def opened(page: Any, address: str) -> Any:
    """Open a view, and wait until it is whole."""
    page.goto("about:blank")
    page.goto(f"/#{address}")
    page.wait_for_selector(".view:not([aria-busy])")
    return page


def test_views_are_accessible_and_usable_on_a_tablet(page: Any) -> None:
    found = []
    for address, heading in VIEWS.items():
        opened(page, address)
        expect(page.locator("h1")).to_have_text(heading)
        found += [(address, *fault) for fault in serious(page)]
        page.set_viewport_size({"width": 820, "height": 1180})
        assert page.evaluate("document.documentElement.scrollWidth") <= 820, address
        page.set_viewport_size({"width": 1280, "height": 800})
    assert not found


def test_the_address_has_the_state_of_a_view(page: Any) -> None:
    opened(page, "/ball/overview?list=maplets")
    expect(page.get_by_role("tab", selected=True)).to_contain_text("Maplets 20")
    page.get_by_role("tab", name="Mapolas").click()
    page.get_by_role("checkbox", name="Mapolas").check()
    expect(page.get_by_role("region", name="List of mapolas")).to_contain_text("AA0003")
    assert "list=mapolas" in page.url
    assert "mapolas" in page.url.partition("show=")[2]


def test_the_keyboard_reaches_content_and_views(page: Any) -> None:
    opened(page, "/ball/runs")
    page.keyboard.press("Tab")
    expect(page.locator(":focus")).to_have_text("Skip to the content")
    page.keyboard.press("Enter")
    expect(page.locator("main")).to_be_focused()
    page.get_by_role("link", name="Jobs").focus()
    page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text("Jobs")


def test_problems_are_shown_in_one_line(page: Any) -> None:
    opened(page, "/none/overview")
    expect(page.get_by_role("alert")).to_have_text("none: there is no such workspace")
