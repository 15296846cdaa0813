"""All routes that read, on a real workspace: no path of the machine, pages, compression."""

from __future__ import annotations

import gzip
import json
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import pytest
from answer_check import examples_in, faults_of, invalid
from asgi_client import AsgiClient
from command_line import called
from routes_walk import answers
from served import Service as Served

from fusion.service.api import Service, create_app
from fusion.service.api.access import rules_of
from fusion.service.jobs import JobKind
from fusion.service.store import Scope, Store

HTTP = Path(__file__).parents[4] / "docs" / "reference" / "http.md"
BENNU = "/api/v1/workspaces/bennu"
# What a workspace with mapolas alone does not have, and the page where it is not built.
NOT_THERE = (
    "/results/", "/products", "/scale/", "/photoclinometry", "/static/", "/fused", "source",
)  # fmt: skip


OCTAHEDRON = """v 0.06 0 0\nv 0 0.06 0\nv -0.06 0 0\nv 0 -0.06 0\nv 0 0 0.06\nv 0 0 -0.06
f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 2 1 6\nf 3 2 6\nf 4 3 6\nf 1 4 6\n"""


@pytest.fixture(scope="module")
def served(
    by_command: tuple[Path, dict], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Served]:
    """The workspace `bennu` with a scan imported from elsewhere, an upload, outputs and jobs."""
    folder = tmp_path_factory.mktemp("missions")
    root = shutil.copytree(by_command[0], folder / "bennu")
    outside = tmp_path_factory.mktemp("outside") / "points.csv"
    outside.write_text("x,y,z\n" + "60.0,0.5,0.25\n60.0,0.25,0.5\n" * 50)
    called("import", root, outside, *(f"--columns={axis}={axis} [m]" for axis in "xyz"))
    called("mapolas", root)
    (root / "SHAPEFILES" / "SHAPE.OBJ").write_text(OCTAHEDRON)
    with Store(folder / ".service" / "store.sqlite") as store:
        service = Served(folder, store)
        upload = service.upload("scan01.dat", b"no scan", "bennu")
        store.uploads.end(upload, store.uploads.get(upload).state)
        service.submit_to("bennu", JobKind.KERNELS, out="kernels")
        service.submit_to("bennu", JobKind.IMPORT, uploads=[upload])
        service.submit_to("bennu", JobKind.RUN, stages=["register"])
        service.submit_to("bennu", JobKind.SOLUTION_EXPORT, name="imported", folder="spc")
        service.work()
        yield service


@pytest.fixture(scope="module")
def client(served: Served) -> Iterator[AsgiClient]:
    with AsgiClient(create_app(Service(served.folder, served.store))) as asking:
        yield asking


def test_no_answer_names_a_path_of_the_machine(client: AsgiClient, served: Served) -> None:
    # That of all folders of tests, so that what lies outside of the service's is found as well.
    hidden = str(served.folder.parent.parent).encode()
    assert hidden in (served.workspace.parent / "bennu" / "provenance" / "ingest.json").read_bytes()
    asked, found = set(), []
    for route, answer in answers(client, "bennu"):
        asked.add(route)
        # A file is sent as it is, and that of a scan has where it came from.
        if hidden in answer.content and not str(answer.url).endswith(".h5"):
            found.append(str(answer.url))
        there = answer.status_code in (200, 503) or any(
            part in str(answer.url) for part in NOT_THERE
        )
        assert there, (answer.url, answer.text)
    assert not found
    reading = {path for method, path in rules_of(client.app) if method == "GET"}
    assert reading - asked == {"/api/v1/events"}
    ingest = client.get(f"{BENNU}/runs/imported:ingest").json()
    assert "points.csv" in ingest["inputs"]
    refused = client.get(f"{BENNU}/results/none")
    assert hidden not in refused.content
    for name in ("catalog.sqlite", "provenance/ingest.json"):
        assert client.get(f"{BENNU}/files/{name}").status_code == 404


def test_answers_and_examples_are_as_described(client: AsgiClient) -> None:
    described = client.get("/api/v1/openapi.json").json()
    tried = 0
    for route, answer in answers(client, "bennu"):
        if route in ("/", "/static/{path:path}"):
            continue
        assert faults_of(described, "GET", route, answer) == [], answer.url
        tried += answer.status_code == 200
    assert tried > 80
    for name, (schema, example) in examples_in(described).items():
        assert schema, name
        assert invalid(described, schema, example) == [], name
    schema, example = examples_in(described)["GET /api/v1/workspaces/{workspace}"]
    assert invalid(described, schema, example | {"maplets": "many"})
    assert invalid(described, schema, example | {"more": 1})


def test_all_lists_have_pages(client: AsgiClient) -> None:
    """Pages of one entry, put together, are the page of all."""
    for route, answer in answers(client, "bennu"):
        described = client.app.openapi()["paths"].get(route.replace(":path", ""), {})
        takes = {one["name"] for one in described.get("get", {}).get("parameters", ())}
        if "limit" not in takes or route.endswith("/log"):
            continue
        content = answer.json()
        key = next(name for name, value in content.items() if isinstance(value, list))
        parts, url = [], f"{answer.url.raw_path.decode()}".partition("?")[0] + "?limit=1"
        while url and len(parts) < 5:
            page = client.get(url)
            assert len(page.json()[key]) <= 1
            parts += page.json()[key]
            url = page.links.get("next", {}).get("url", "")
        assert parts == content[key][: len(parts)], route
        assert len(parts) == min(5, len(content[key])), route
    gone = client.get(f"{BENNU}/runs?after=none")
    assert (gone.status_code, gone.json()["where"]) == (422, "after")


def test_long_texts_are_compressed_under_another_tag(client: AsgiClient) -> None:
    url = f"{BENNU}/mapolas"
    plain, packed = (
        client.get(url, headers={"Accept-Encoding": coding}) for coding in ("gzip;q=0", "br, gzip")
    )
    assert packed.headers["content-encoding"] == "gzip"
    assert "content-encoding" not in plain.headers
    assert packed.json() == plain.json()
    assert int(packed.headers["content-length"]) == len(gzip.compress(plain.content, 2, mtime=0))
    assert packed.headers["etag"] != plain.headers["etag"]
    assert "Accept-Encoding" in packed.headers["vary"]
    for answer, coding in ((plain, "identity"), (packed, "gzip")):
        headers = {"If-None-Match": answer.headers["etag"], "Accept-Encoding": coding}
        assert client.get(url, headers=headers).status_code == 304
    for other in (f"{BENNU}/shape?facets=100", f"{BENNU}/files/spcola.toml", "/health"):
        assert "content-encoding" not in client.get(other).headers


def examples() -> Iterator[list[str]]:
    """Yield the words of each example of the reference."""
    for text in re.findall(r"`curl (.*?)` \|", HTTP.read_text()):
        yield shlex.split(text)


def test_the_examples_of_the_reference_work(client: AsgiClient, served: Served) -> None:
    store = served.store
    job, upload = store.jobs()[0].id, store.uploads.kept("bennu")[0].id
    _, token = store.tokens.make("anna", {"bennu": Scope.RUN})
    there = {
        "00000001-113f7baa": job, "k3v9": upload, "4f1d2c3b5a69": token.id, "AB0001": "AA0001",
        "9f86…": "0" * 64, '"name": "bennu"': '"name": "new"',
        "fuse/diff/imported:fuse?other=bennu-2": "mapolas/diff/imported:mapolas",
        "imported:fuse": "imported:mapolas", "scaled-1": "imported", "scan01.dat": "other.dat",
        "scale.json": "spcola.toml", "scale-pairs": "scans", "product=release/manifest.json":
        "product=mapolas/AA0000.MAP", "kernels/spc_states.tm": "spc/MAPFILES/AA0001.MAP",
        "outputs/kernels": "outputs/spc", '"kind": "run", ': "",
    }  # fmt: skip
    tried = 0
    for words in examples():
        method, body, headers, url = "GET", None, {}, ""
        rest = iter(words)
        for word in rest:
            if word in ("-X", "-d", "-H", "-r", "--data-binary"):
                value = next(rest)
                method = value if word == "-X" else "POST" if word == "-d" else method
                body = value if word == "-d" else b"" if word == "--data-binary" else body
                if word == "-H":
                    headers |= dict([value.split(": ", 1)])
                headers |= {"Range": f"bytes={value}"} if word == "-r" else {}
            elif word == "-I":
                method = "HEAD"
            elif word != "-N":
                url = word
        if method == "DELETE" or url.endswith("/complete") or "/events" in url:
            continue
        for name, real in there.items():
            url, body = (
                url.replace(name, real),
                body.replace(name, real) if isinstance(body, str) else body,
            )
        if isinstance(body, str):
            json.loads(body)
            headers["Content-Type"] = "application/json"
        answer = client.request(method, url, content=body, headers=headers)
        missing = any(part in unquote(url) for part in NOT_THERE) and answer.status_code == 404
        built = url == "/" and answer.status_code == 503
        assert answer.status_code < 400 or missing or built, (words, url, answer.text)
        tried += 1
    assert tried > 50
