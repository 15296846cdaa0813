"""Work through the page: runs, forms of other jobs, uploads with resume, outputs, tokens."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from pathlib import Path
from typing import Any

import httpx
from command_line import called
from playwright.sync_api import expect
from server_process import ServerProcess

from spcola.formats.maplets import read_maplet
from spcola.formats.shapes import write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions

PATIENCE_MS = 60_000
HAS_JOBS = True


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
        # It cannot begin before it is cancelled, unless that takes longer than five others.
        second = first
        for _ in range(5):
            second = client.post("/jobs", json=run | {"after": [second]}).json()["id"]
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
    # Another visit: the file is chosen again. Until then nothing passes: this page tries again.
    page.reload()
    page.unroute("**/uploads/*")
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


def test_forms_take_files_columns_and_names(page: Any, served: str, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("east,north,up\n" + "60.0,0.5,0.25\n60.0,0.25,0.5\n" * 50)
    page.goto("/#/ball/jobs/new/import")
    page.get_by_text("Send from this computer").click()
    page.get_by_label("Send files for uploads").set_input_files(table)
    expect(page.get_by_label("table.csv (scan")).to_be_checked(timeout=PATIENCE_MS)
    page.get_by_label("columns").fill("x=east [m]\ny=north [km\nz=up [m]")
    page.get_by_label("format").fill("tables")
    page.get_by_role("button", name="Submit").click()
    finished = page.locator("dd .state")
    expect(finished).to_have_text(re.compile("failed"), timeout=PATIENCE_MS)
    # What was given is there again.
    page.get_by_role("link", name="Again, with changes").click()
    expect(page.get_by_label("table.csv (scan")).to_be_checked()
    page.get_by_label("columns").fill("x=east [m]\ny=north [m]\nz=up [m]")
    page.get_by_label("format").fill("")
    page.get_by_role("button", name="Submit").click()
    expect(finished).to_have_text(re.compile("finished"), timeout=PATIENCE_MS)
    expect(page.get_by_role("log")).to_contain_text("(table), 100 returns")
    (job, *_) = httpx.get(f"{served}api/v1/workspaces/ball/jobs").json()["jobs"]
    assert job["parameters"].keys() == {"uploads", "columns"}
    assert job["parameters"]["columns"] == {"x": "east [m]", "y": "north [m]", "z": "up [m]"}
    page.goto("/#/ball/jobs/uploads")
    page.get_by_role("button", name="Remove all imported").click()
    expect(page.locator("main [role=status]")).to_contain_text("1 upload is removed")
    expect(page.get_by_role("row").filter(has_text="table.csv")).to_have_count(0)


def test_what_the_service_refuses_is_marked_in_the_form(page: Any) -> None:
    page.goto("/#/ball/jobs/new/images?states=spice&report=true")
    page.get_by_role("button", name="Submit").click()
    expect(page.get_by_role("alert")).to_contain_text("frame: is needed with states spice")
    frame = page.get_by_label("frame", exact=True)
    expect(frame).to_be_focused()
    expect(frame).to_have_attribute("aria-invalid", "true")


def test_outputs_are_listed_downloaded_and_removed(page: Any) -> None:
    page.goto("/#/ball/solutions")
    page.get_by_role("link", name="Export imported").click()
    page.get_by_label("folder").fill("spc")
    page.get_by_role("button", name="Submit").click()
    page.get_by_role("link", name="Outputs of jobs").click(timeout=PATIENCE_MS)
    page.get_by_text("spc/ (").click()
    with page.expect_download() as waiting:
        page.get_by_role("link", name="spc/MAPFILES/AA0001.MAP").click()
    assert read_maplet(Path(waiting.value.path())).grid.half_size == 24
    page.get_by_role("button", name="Remove spc").click()
    expect(page.get_by_text("No outputs yet.")).to_be_visible()


def test_a_new_workspace_takes_a_whole_spc_folder(page: Any, folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "ball"
    shutil.copytree(folder / "ball", source)
    write_obj_mesh(source / "SHAPEFILES" / "SHAPE.TXT", IcqShape(60 * icq_directions(4)).mesh())
    called("solution", "export", source, "imported", tmp_path / "spc")
    (tmp_path / "spc" / "MAPFILES" / ".hidden").write_text("no SPC file")
    page.goto("/")
    page.get_by_text("New workspace").click()
    page.get_by_label("Name").fill("copy")
    page.get_by_label("Body", exact=True).fill("Ball")
    page.get_by_label("SPC working folder").set_input_files(tmp_path / "spc")
    page.get_by_role("button", name="Make").click()
    page.get_by_role("link", name="its job").click(timeout=PATIENCE_MS)
    expect(page.locator("dd .state")).to_have_text(re.compile("finished"), timeout=PATIENCE_MS)
    names = {path.name for path in (folder / "ball" / "MAPFILES").iterdir()}
    assert {path.name for path in (folder / "copy" / "MAPFILES").iterdir()} == names
    assert any((folder / "copy" / "SHAPEFILES").iterdir())


def test_tokens_are_made_shown_once_and_revoked(page: Any, served: str) -> None:
    page.goto("/")
    page.get_by_role("link", name="Tokens").click()
    page.get_by_text("New token").click()
    page.get_by_label("User").fill("eve")
    page.get_by_label("Scope in ball").select_option("read")
    page.get_by_role("button", name="Make the token").click()
    secret = page.get_by_label("Secret").input_value()
    headers = {"Authorization": f"Bearer {secret}"}
    asked = f"{served}api/v1/caller"
    assert httpx.get(asked, headers=headers).json() == {"user": "eve", "scopes": {"ball": "read"}}
    with page.context.new_page() as reader:
        reader.goto("/")
        reader.evaluate("secret => sessionStorage.setItem('spcola-token', secret)", secret)
        reader.goto("/#/ball/jobs/new/images")
        reader.reload()
        expect(reader.get_by_role("note")).to_contain_text("may read ball, not run jobs in it")
        expect(reader.locator("form")).to_be_hidden()
        reader.goto("/#/ball/jobs")
        expect(reader.get_by_role("link", name="Uploads")).to_be_visible()
        expect(reader.get_by_role("link", name="New run")).to_be_hidden()
    page.on("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name=re.compile("of eve")).click()
    expect(page.get_by_role("row").filter(has_text="eve")).to_contain_text("revoked")
    assert httpx.get(asked, headers=headers).status_code == 401
    assert secret not in page.content()
    page.get_by_role("link", name="Audit log").click()
    entries = page.get_by_role("region", name="Entries of the audit log")
    expect(entries).to_contain_text("revoke_token")


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
        page.get_by_role("link", name="SPCOLA").click()
        expect(page.locator("h1")).to_have_text("Workspaces")
        expect(page.get_by_role("link", name="Tokens")).to_have_count(0)
        assert not page.evaluate("Object.keys(localStorage)")
        page.get_by_role("button", name="Forget token").click()
        expect(page.get_by_label("Token")).to_be_visible()
        context.close()


def _offset(request: Any) -> str:
    return str(request.headers["upload-offset"])
