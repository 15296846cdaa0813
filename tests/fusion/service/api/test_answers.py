"""Pages, ETags, ranges, forms, and events."""

from __future__ import annotations

import asyncio
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from asgi_client import AsgiClient
from pyarrow import parquet

from fusion.service.api import Service
from fusion.service.api.errors import RequestRefusedError
from fusion.service.api.events import stream
from fusion.service.api.files import byte_range
from fusion.service.api.rate import RateLimit
from fusion.service.api.recent import RecentAnswers
from fusion.service.jobs import JobKind, JobRequest, JobState
from spcola.formats.maplets import read_maplet, write_maplet

JOBS = "/api/v1/workspaces/ball/jobs"
MAPLET = "/api/v1/workspaces/ball/surfaces/maplet/AA0001"
CONTENT = bytes(range(200))


def test_jobs_are_submitted_once_listed_in_pages_and_cancelled(client: AsgiClient) -> None:
    run = {"kind": "run", "parameters": {"stages": ["mapolas"]}}
    key = {"Idempotency-Key": "once"}
    first = client.post(JOBS, json=run, headers=key)
    assert first.status_code == 202
    assert client.post(JOBS, json=run, headers=key).json()["id"] == first.json()["id"]
    other = client.post(JOBS, json={"kind": "run"}, headers=key)
    assert (other.status_code, other.json()["code"]) == (422, "key-reused")
    made = [first.json()["id"], *(client.post(JOBS, json=run).json()["id"] for _ in range(4))]
    listed, url = [], f"{JOBS}?limit=2&state=waiting"
    while url:
        page = client.get(url)
        listed += [job["id"] for job in page.json()["jobs"]]
        url = page.links.get("next", {}).get("url", "")
    assert listed == made[::-1]
    assert client.get(first.headers["location"]).json()["user"] == "local"
    assert client.post(f"{first.headers['location']}/cancel").json()["state"] == "cancelled"
    forecast = client.post(JOBS.replace("jobs", "forecast"), json=run | {"kind": "x"})
    assert forecast.status_code == 422
    forecast = client.post(JOBS.replace("jobs", "forecast"), json={"parameters": {}})
    assert forecast.json()["kind"] == "forecast"


def test_what_is_known_is_not_sent_again(client: AsgiClient) -> None:
    for url in (JOBS, MAPLET, f"{MAPLET}/tiles/1/0/0", "/api/v1/workspaces/ball/files/spcola.toml"):
        first = client.get(url)
        assert first.status_code == 200, first.text
        tag = first.headers["etag"]
        again = client.get(url, headers={"If-None-Match": f'"other", {tag}'})
        assert (again.status_code, again.content) == (304, b"")
    client.post(JOBS, json={"kind": "run"})
    assert client.get(JOBS, headers={"If-None-Match": tag}).status_code == 200


def test_files_have_ranges_and_lead_nowhere_else(service: Service, client: AsgiClient) -> None:
    folder = service.root / "ball" / "release"
    (folder / "a b.bin").write_bytes(CONTENT)
    (folder / "out").symlink_to(service.root / "other" / "spcola.toml")
    (folder / ".hidden").write_bytes(CONTENT)
    base = "/api/v1/workspaces/ball/files"
    part = client.get(f"{base}/release/a b.bin", headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, CONTENT[10:20])
    assert part.headers["content-range"] == "bytes 10-19/200"
    assert "sandbox" in part.headers["content-security-policy"]
    changed = {"Range": "bytes=10-19", "If-Range": '"other"'}
    assert client.get(f"{base}/release/a b.bin", headers=changed).content == CONTENT
    beyond = client.get(f"{base}/release/a b.bin", headers={"Range": "bytes=200-"})
    assert beyond.json()["code"] == "range-not-satisfiable"
    names = ("release/out", "release/.hidden", "release", "..%2fother/spcola.toml", "release/%00")
    for name in (*names, "%2fetc/passwd", "release/../../other/spcola.toml"):
        assert client.get(f"{base}/{name}").status_code == 404, name


@pytest.mark.parametrize(
    ("header", "part"),
    [
        ("bytes=0-0", (0, 0)),
        ("bytes=-5", (95, 99)),
        ("bytes=90-500", (90, 99)),
        ("bytes=7-", (7, 99)),
        ("bytes=5-2", None),
        ("lines=1-2", None),
        ("bytes=1-2,4-5", None),
        ("bytes=-", None),
        ("bytes=²-", None),
        ("", None),
    ],
)
def test_ranges(header: str, part: tuple[int, int] | None) -> None:
    assert byte_range(header, 100) == part


@pytest.mark.parametrize(
    ("header", "size"), [("bytes=100-", 100), ("bytes=-0", 9), ("bytes=0-", 0)]
)
def test_ranges_outside_are_refused(header: str, size: int) -> None:
    with pytest.raises(RequestRefusedError):
        byte_range(header, size)


def test_surfaces_as_numbers_pictures_and_values(client: AsgiClient) -> None:
    about = client.get(MAPLET).json()
    assert (about["size"], about["gsd_m"]) == (25, pytest.approx(0.5))
    asked = "window?layer=height&row=2&column=3&rows=4&columns=5"
    answer = client.get(f"{MAPLET}/{asked}")
    window = np.frombuffer(answer.content, "<f4").reshape(4, 5)
    assert answer.headers["x-rows"] == "4"
    # The planted slope: heights grow along Uy, to the right in the window.
    np.testing.assert_allclose(window, np.tile(np.arange(3.0, 8.0) / 10, (4, 1)), atol=1e-3)
    assert client.get(f"{MAPLET}/{asked}&format=png").content.startswith(b"\x89PNG")
    tile = client.get(f"{MAPLET}/tiles/1/0/0?format=float32")
    assert len(tile.content) == 4 * 256**2
    value = client.get(f"{MAPLET}/value?x=0&y=0").json()
    assert value["layers"]["height"] == pytest.approx(1.2, abs=1e-3)
    line = client.get(f"{MAPLET}/profile?from=-5,0&to=5,0&layers=height").json()
    assert np.all(np.diff(line["layers"]["height"]) > 0)
    assert client.get(f"{MAPLET}/profile?from=0&to=0,1").status_code == 422
    listed = client.get("/api/v1/workspaces/ball/surfaces").json()
    assert listed == {"surfaces": [{"kind": "maplet", "name": "AA0001"}]}
    assert about["same_place"] == listed["surfaces"]
    around = client.get("/api/v1/workspaces/ball/outlines?kind=maplet").json()
    assert (around["name"], around["side_m"]) == (["AA0001"], pytest.approx([12.0]))
    layers = client.get("/api/v1/workspaces/ball/shape/layers").json()["layers"]
    assert {each["name"]: each["of"] for each in layers} == dict.fromkeys(
        ("albedo", "sigma"), "maplet"
    )


def test_a_tile_that_was_kept_is_drawn_again_when_its_file_has_changed(
    service: Service, client: AsgiClient
) -> None:
    tile = f"{MAPLET}/tiles/1/0/0?format=float32"
    first, again = client.get(tile), client.get(tile)
    assert again.content == first.content
    path = service.root / "ball/MAPFILES/AA0001.MAP"
    higher = read_maplet(path)
    write_maplet(path, replace(higher, height=higher.height + 1.0))
    after = client.get(tile, headers={"If-None-Match": first.headers["etag"]})
    assert after.status_code == 200
    rise = np.frombuffer(after.content, "<f4") - np.frombuffer(first.content, "<f4")
    assert np.nanmean(rise) == pytest.approx(1.0, abs=1e-3)
    assert client.get(f"{tile}&low=0").content == after.content
    pictures = {client.get(f"{MAPLET}/tiles/1/0/0?low=0&high={high}").content for high in (2, 4)}
    assert len(pictures) == 2


def test_an_answer_that_was_asked_for_before_it_was_forgotten_is_not_remembered() -> None:
    """A token is revoked while the store is being asked about it."""
    asked: list[str] = []

    def ask(about: str) -> int:
        asked.append(about)
        if len(asked) == 1:
            answers.forget()
        return len(asked)

    answers = RecentAnswers(ask)

    async def find() -> list[int]:
        return [await answers.find("token") for _ in range(3)]

    assert asyncio.run(find()) == [1, 2, 2]


def test_tables_have_the_form_that_is_accepted(client: AsgiClient) -> None:
    base = "/api/v1/workspaces/ball/tables"
    name = client.get(base).json()["tables"][0]
    rows = client.get(f"{base}/{name}").json()
    assert rows["name"] == name
    form = {"Accept": "text/html, application/vnd.apache.arrow.stream;q=0.9, */*;q=0.1"}
    stream_of = client.get(f"{base}/{name}", headers=form)
    assert pyarrow.ipc.open_stream(stream_of.content).read_all().num_rows == rows["rows"]
    packed = client.get(f"{base}/{name}", headers={"Accept": "application/vnd.apache.parquet"})
    assert parquet.read_table(io.BytesIO(packed.content)).num_rows == rows["rows"]
    refused = client.get(f"{base}/{name}", headers={"Accept": "text/html"})
    assert refused.json()["code"] == "not-acceptable"


def test_events_go_on_where_a_reader_left_off(service: Service) -> None:
    store = service.store
    jobs = [store.submit(JobRequest(JobKind.RUN, name, "ann")) for name in ("ball", "other")]

    async def read(after: int, count: int, **chosen: object) -> list[str]:
        async with service.feed.running():
            asked = {"job": "", "workspaces": None, "heartbeat_s": 0.05} | chosen
            texts = stream(service.feed, after, **asked)
            found = []
            async for text in texts:
                found.append(text)
                if len(found) == 2:
                    # What happens while the stream is open is sent as well.
                    store.cancel(jobs[0].id)
                if len([one for one in found if one.startswith("id:")]) == count:
                    break
            return [one for one in found if one.startswith("id:")]

    first = asyncio.run(read(0, 3, workspaces=["ball", "other"]))
    numbers = [int(text.partition("\n")[0].removeprefix("id: ")) for text in first]
    assert numbers == [event.number for event in store.events()]
    assert f'"state":"{JobState.CANCELLED.value}"' in first[-1]
    service.feed = type(service.feed)(store)
    resumed = asyncio.run(read(numbers[0], 1, job=jobs[0].id))
    assert resumed == first[-1:]


def test_a_stream_shows_that_it_lives_and_ends_with_the_server(service: Service) -> None:
    async def read() -> list[str]:
        found = []
        async with service.feed.running():
            async for text in stream(
                service.feed, 0, job="", workspaces=["ball"], heartbeat_s=0.02
            ):
                found.append(text)
                if len(found) == 3:
                    await service.feed.close()
        return found

    assert asyncio.run(read())[:3] == ["retry: 2000\n\n", ": still here\n\n", ": still here\n\n"]


def test_a_bucket_fills_at_its_rate() -> None:
    limit = RateLimit(2.0, 3)
    assert [limit.wait_s("a", 0.0) for _ in range(4)] == [0.0, 0.0, 0.0, 0.5]
    assert limit.wait_s("b", 0.0) == 0.0
    assert limit.wait_s("a", 0.5) == 0.0
    assert limit.wait_s("a", 0.5) == pytest.approx(0.5)
    # A clock that steps back takes nothing away.
    assert limit.wait_s("a", 0.0) == pytest.approx(0.5)


def test_the_process_says_how_it_is(service: Service, client: AsgiClient) -> None:
    assert client.get("/health").json()["status"] == "ok"
    assert client.get("/ready").json()["status"] == "ready"
    client.post(JOBS, json={"kind": "run"})
    text = client.get("/metrics").text
    assert 'spcola_jobs{state="waiting"} 1.0' in text
    route = 'route="/api/v1/workspaces/{workspace}/jobs"'
    assert f'spcola_requests_total{{method="POST",{route},status="202"}} 1.0' in text
    Path(service.store._database.path).unlink()
    assert client.get("/ready").status_code == 503


def test_outputs_of_jobs_are_listed_sent_and_removed(
    service: Service, client: AsgiClient, tmp_path: Path
) -> None:
    folder = service.root / ".service" / "outputs" / "ball"
    (folder / "kernels").mkdir(parents=True)
    (folder / "kernels" / "a.tf").write_text("frame")
    (folder / "nac.toml").write_text("camera")
    (folder / ".00000001-ab").mkdir()
    (folder / ".00000001-ab" / "unfinished").write_text("x")
    (folder / "link").symlink_to(tmp_path)
    where = "/api/v1/workspaces/ball/outputs"
    assert client.get(where).json()["outputs"] == [
        {"name": "kernels/a.tf", "bytes": 5},
        {"name": "nac.toml", "bytes": 6},
    ]
    page = client.get(f"{where}?limit=1")
    assert [one["name"] for one in page.json()["outputs"]] == ["kernels/a.tf"]
    assert 'after=kernels%2Fa.tf>; rel="next"' in page.headers["link"]
    part = client.get(f"{where}/kernels/a.tf", headers={"Range": "bytes=1-2"})
    assert (part.status_code, part.text) == (206, "ra")
    for name in (".00000001-ab/unfinished", "none", "kernels"):
        assert client.get(f"{where}/{name}").status_code == 404
    assert client.get(f"{where.replace('ball', 'other')}/nac.toml").status_code == 404
    for name in ("kernels", "nac.toml", "link"):
        assert client.delete(f"{where}/{name}").status_code == 204
    assert client.delete(f"{where}/nac.toml").status_code == 404
    assert tmp_path.is_dir()
    assert client.get(where).json()["outputs"] == []


def test_a_job_that_cannot_begin_is_refused_with_what_there_is(client: AsgiClient) -> None:
    where = "/api/v1/workspaces/ball/jobs"

    def refused(kind: str, after: str = "", **parameters: object) -> dict:
        asked = {"kind": kind, "parameters": parameters, "after": [after] if after else []}
        answer = client.post(where, json=asked)
        assert answer.status_code == 422, answer.text
        return answer.json()

    assert "mapolas" in refused("run", stages=["maplas"])["do"]
    assert "gsd_m" in refused("run", settings={"mapolas": {"gsd": 1.0}})["do"]
    assert "imported" in refused("run", solution="none")["do"]
    assert refused("images")["where"] == "uploads"
    assert "complete upload" in refused("import", uploads=["none"])["detail"]
    assert refused("camera-convert", uploads=["none"], out="a/b")["code"] == "invalid-value"
    first = client.post(where, json={"kind": "scale-apply", "parameters": {"name": "s1"}}).json()
    later = {"kind": "run", "parameters": {"solution": "s1"}, "after": [first["id"]]}
    assert client.post(where, json=later).status_code == 202
    kinds = {one["kind"]: one for one in client.get("/api/v1/job-kinds").json()["kinds"]}
    assert kinds["kernels"]["command"] == "kernels"
    assert kinds["kernels"]["parameters"]["properties"]["max_gap_s"]["maximum"] == 1e7
