"""Work through the page: submit with a forecast, watch, cancel, upload with resume, token."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path
from typing import Any

import httpx
from command_line import called
from playwright.sync_api import expect
from server_process import ServerProcess

PATIENCE_MS = 60_000


def test_a_run_is_forecast_submitted_and_watched(page: Any) -> None:
    page.goto("/#/ball/jobs/new")
    page.get_by_label("mapolas").check()
    page.get_by_label("Also what is up to date").check()
    page.get_by_role("button", name="Forecast").click()
    forecast = page.get_by_role("region", name="Forecast of the run")
    expect(forecast).to_contain_text("mapolas", timeout=PATIENCE_MS)
    page.get_by_role("button", name="Submit the run").click()
    expect(page.get_by_role("log")).to_contain_text("mapolas: ran", timeout=PATIENCE_MS)
    expect(page.locator("dd .state")).to_have_text(re.compile("finished"), timeout=PATIENCE_MS)
    expect(page.get_by_role("region", name="Stages of the run")).to_contain_text("ran")


def test_the_list_of_jobs_is_live_and_cancels(page: Any, served: str) -> None:
    page.goto("/#/ball/jobs")
    expect(page.get_by_role("status").first).to_have_text("live")
    with httpx.Client(base_url=f"{served}api/v1/workspaces/ball") as client:
        run = {"parameters": {"stages": ["mapolas"], "force": True}}
        first = client.post("/jobs", json=run).json()["id"]
        # It cannot begin before it is cancelled, unless that takes longer than the first.
        second = client.post("/jobs", json=run | {"after": [first]}).json()["id"]
    page.get_by_role("button", name=f"Cancel {second}").click()
    row = page.get_by_role("row").filter(has_text=second)
    expect(row).to_contain_text("cancelled", timeout=PATIENCE_MS)
    done = page.get_by_role("row").filter(has_text=first)
    expect(done).to_contain_text("finished", timeout=PATIENCE_MS)


def test_a_broken_upload_goes_on_where_it_was(page: Any, served: str, tmp_path: Path) -> None:
    content = os.urandom(20 << 20)
    file = tmp_path / "poses.csv"
    file.write_bytes(content)
    sent: list[str] = []

    def broken_after_one(route: Any) -> None:
        if route.request.method == "PATCH":
            if sent:
                route.abort()
                return
            sent.append(route.request.headers["upload-offset"])
        route.continue_()

    page.route("**/uploads/*", broken_after_one)
    page.goto("/#/ball/jobs/uploads")
    page.get_by_label("What").select_option("kernel")
    page.get_by_label("Files").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    expect(page.get_by_text("sending 40 %")).to_be_visible(timeout=PATIENCE_MS)
    page.unroute("**/uploads/*")
    # Another visit: the file is chosen again.
    page.reload()
    offsets: list[str] = []
    page.on("request", lambda one: one.method == "PATCH" and offsets.append(_offset(one)))
    page.get_by_label("What").select_option("kernel")
    page.get_by_label("Files").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    row = page.get_by_role("row").filter(has_text="poses.csv")
    expect(row).to_contain_text("complete", timeout=PATIENCE_MS)
    assert sent == ["0"]
    assert offsets == [str(8 << 20), str(16 << 20)]
    (upload,) = httpx.get(f"{served}api/v1/workspaces/ball/uploads").json()["uploads"]
    assert upload["sha256"] == hashlib.sha256(content).hexdigest()
    page.get_by_role("button", name="Remove poses.csv").click()
    expect(page.get_by_text("No uploads wait.")).to_be_visible()


def test_a_download_is_the_file(page: Any) -> None:
    page.goto("/#/ball/products")
    with page.expect_download() as waiting:
        page.get_by_role("row").filter(has_text="scans").get_by_role("link", name="CSV").click()
    text = Path(waiting.value.path()).read_text()
    assert text.splitlines()[1].split(",").count("scan0") == 1


def test_a_token_is_asked_for_and_kept_in_the_tab(chromium: Any, tmp_path: Path) -> None:
    called("init", tmp_path / "moon", "--body", "Moon")
    secret = called("serve", "token", "add", tmp_path, "ann")["secret"]
    with ServerProcess(tmp_path, "--name", "spcola.example", "--workers", "0") as server:
        context = chromium.new_context(base_url=server.url)
        page = context.new_page()
        page.goto("/#/moon/overview")
        page.get_by_label("Token").fill("wrong")
        page.get_by_role("button", name="Enter").click()
        expect(page.get_by_role("alert")).to_contain_text("token")
        page.get_by_label("Token").fill(secret)
        page.get_by_role("button", name="Enter").click()
        expect(page.locator("h1")).to_have_text("moon")
        page.reload()
        expect(page.locator("h1")).to_have_text("moon")
        assert not page.evaluate("Object.keys(localStorage)")
        page.get_by_role("button", name="Forget token").click()
        expect(page.get_by_label("Token")).to_be_visible()
        context.close()


def _offset(request: Any) -> str:
    return str(request.headers["upload-offset"])
