"""Maps in a real browser: values, swipe, profiles, gaps and links."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from page_views import GAP, ready, serious, worth_a_look
from playwright.sync_api import expect

from spcola.formats.maplets import read_maplet

FUSED = "/ball/map/fused/AA0001"
MAPLET = "/ball/map/maplet/AA0001"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a workspace that has something in every view."""
    root = tmp_path_factory.mktemp("maps")
    worth_a_look(root / "ball")
    return root


def place_of(page: Any, x: float, y: float) -> tuple[float, float]:
    """Return where a point of the map, metres from its middle, lies in the window."""
    box = page.locator(".chart").bounding_box()
    query = dict(part.split("=") for part in page.url.partition("?")[2].split("&"))
    east, north = (float(each) for each in query["center"].replace("%2C", ",").split(","))
    across = (x - east) / float(query["zoom"])
    up = (y - north) / float(query["zoom"])
    return box["x"] + box["width"] / 2 + across, box["y"] + box["height"] / 2 - up


def shown(page: Any, layer: str) -> float:
    text = page.locator(f".values [data-layer={layer}] dd").inner_text()
    return float(text.replace("−", "-").split()[0])


def pixel(page: Any, x: float, y: float) -> list[int]:
    """Return the colour that the map's own pictures have at a point."""
    at = place_of(page, x, y)
    script = """([x, y]) => {
        const canvas = document.querySelector('.surface-0 canvas');
        const box = canvas.getBoundingClientRect();
        const share = canvas.width / box.width;
        const context = canvas.getContext('2d');
        return [...context.getImageData((x - box.x) * share, (y - box.y) * share, 1, 1).data];
    }"""
    return page.evaluate(script, list(at))


def test_values_under_the_cursor_are_those_of_the_array(page: Any, folder: Path) -> None:
    maplet = read_maplet(folder / "ball/MAPFILES/AA0001.MAP")
    ready(page, f"{MAPLET}?layer=height")
    grid = maplet.grid
    for m, n in ((12, 12), (20, 9), (9, 21)):
        # Nodes count along Uy to the right and along Ux down.
        x, y = (m - grid.half_size) * grid.gsd, (grid.half_size - n) * grid.gsd
        page.mouse.move(*place_of(page, x, y))
        # The last place is another one: its values are replaced.
        expect(page.locator(".values")).to_contain_text(f"{x:.1f}".replace("-", "−"))
        page.wait_for_timeout(300)
        assert shown(page, "height") == pytest.approx(maplet.height[m, n], abs=0.02)
        assert shown(page, "albedo") == pytest.approx(maplet.albedo[m, n], abs=0.03)


def test_unknown_is_never_drawn_as_a_value(page: Any, folder: Path) -> None:
    maplet = read_maplet(folder / "ball/MAPFILES/AA0001.MAP")
    assert np.isnan(maplet.height[GAP]).all()
    ready(page, f"{MAPLET}?layer=height&shade=0")
    grid = maplet.grid
    gap = (2 - grid.half_size) * grid.gsd
    assert pixel(page, gap, -gap)[3] == 0
    assert pixel(page, 0.0, 0.0)[3] == 255
    page.mouse.move(*place_of(page, gap, -gap))
    expect(page.locator(".values [data-layer=height] dd")).to_have_text("unknown")


def test_range_and_colours_change_without_loading_again(page: Any) -> None:
    ready(page, f"{FUSED}?layer=height&shade=0")
    before = pixel(page, 0.0, 0.0)
    asked: list[str] = []
    page.on("request", lambda request: "/tiles/" in request.url and asked.append(request.url))
    page.get_by_label("Highest value of the colours").fill("50")
    page.keyboard.press("Enter")
    page.locator("select[name=colours]").select_option("grey")
    page.wait_for_timeout(300)
    after = pixel(page, 0.0, 0.0)
    assert before != after
    assert after[0] == after[1] == after[2]
    assert not asked
    assert "colours=grey" in page.url


def test_the_bar_swipes_by_pointer_and_keys(page: Any) -> None:
    ready(page, FUSED)
    page.locator("select[name=swipe]").select_option("maplet/AA0001")
    bar = page.get_by_role("slider", name="Border between both surfaces")
    expect(bar).to_have_attribute("aria-valuenow", "50")
    box = bar.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] - 150, box["y"] + 100)
    page.mouse.up()
    moved = int(bar.get_attribute("aria-valuenow"))
    assert moved < 40
    bar.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(bar).to_have_attribute("aria-valuenow", str(moved + 6))
    # Left of the bar the values are those of the first surface, right of it those of the second.
    for x, name in ((-5.0, "fused AA0001"), (5.0, "maplet AA0001")):
        page.mouse.move(*place_of(page, x, 0.0))
        expect(page.locator(".values")).to_contain_text(name)


def test_a_profile_has_the_numbers_of_the_service(page: Any, served: str, tmp_path: Path) -> None:
    ready(page, FUSED)
    page.get_by_role("button", name="Draw").click()
    page.mouse.click(*place_of(page, -4.0, -2.0))
    page.mouse.click(*place_of(page, 4.0, 3.0))
    expect(page.locator(".profile")).to_be_visible()
    line = re.search(r"line=([^&]+)", page.url)[1].replace("%2C", ",").split(",")
    np.testing.assert_allclose([float(each) for each in line], [-4, -2, 4, 3], atol=0.05)
    with page.expect_download() as waiting:
        page.get_by_role("button", name="Save as CSV").click()
    waiting.value.save_as(tmp_path / "profile.csv")
    table = np.genfromtxt(tmp_path / "profile.csv", delimiter=",", names=True)
    begin, end = ",".join(line[:2]), ",".join(line[2:])
    asked = f"{served}api/v1/workspaces/ball/surfaces/fused/AA0001/profile"
    answer = httpx.get(asked, params={"from": begin, "to": end}).json()
    np.testing.assert_array_equal(table["distance_m"], answer["distance_m"])
    for layer in ("height", "sigma"):
        np.testing.assert_array_equal(table[layer], answer["layers"][layer])


def test_a_link_restores_the_view(page: Any) -> None:
    state = "layer=sigma&range=0%2C0.1&colours=viridis&shade=30&center=1%2C2&zoom=0.02"
    state += "&swipe=maplet%2FAA0001%400.300&line=-3%2C0%2C3%2C1&profile=sigma"
    ready(page, f"{FUSED}?{state}")
    expect(page.locator("select[name=layer]")).to_have_value("sigma")
    expect(page.get_by_label("Highest value of the colours")).to_have_value("0.1000")
    slider = page.get_by_role("slider", name="Border between both surfaces")
    expect(slider).to_have_attribute("aria-valuenow", "30")
    expect(page.locator(".profile")).to_be_visible()
    page.wait_for_timeout(300)
    entries = dict(part.split("=") for part in page.url.partition("?")[2].split("&"))
    assert entries == dict(part.split("=") for part in state.split("&"))


def test_map_and_plots_are_accessible(page: Any) -> None:
    found = []
    for address in (
        f"{FUSED}?swipe=maplet/AA0001@0.5&line=-3,0,3,1",
        "/ball/registration",
        "/ball/scale",
    ):
        ready(page, address)
        found += [(address, *one) for one in serious(page)]
    assert not found


def test_rejected_matches_are_marked_and_the_table_sorts(page: Any) -> None:
    ready(page, "/ball/registration")
    expect(page.locator(".u-legend").first).to_contain_text("✕ rejected")
    table = page.get_by_role("region", name="Matches")
    expect(table.locator("tbody tr").first).to_contain_text("AA0011")
    expect(table.get_by_role("row", name=re.compile("AA0005"))).to_contain_text("✕ rejected")
    table.get_by_role("button", name="Mapola").click()
    expect(table.locator("tbody tr").first).to_contain_text("AA0000")


def test_epsilon_has_its_sigma_and_codes(page: Any) -> None:
    ready(page, "/ball/scale")
    expect(page.locator(".result")).to_contain_text("ε = 234 ± 20 ppm")
    expect(page.get_by_role("list", name="Findings")).to_contain_text("range_bias_m")
    expect(page.locator(".card h2")).to_have_text(["Per day", "By local time", "By longitude"])
