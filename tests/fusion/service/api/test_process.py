"""The real server process: ``spcola serve`` with a worker, asked over HTTP."""

from __future__ import annotations

import json
import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from command_line import called, refused
from damage import files_in
from server_process import ServerProcess

PART = b"0123456789" * 40


@pytest.fixture(scope="module")
def folder(ball: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("missions")
    shutil.copytree(ball, root / "ball")
    return root


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[ServerProcess]:
    """A running service."""
    server = ServerProcess(folder)
    yield server
    server.kill()


def test_a_run_through_the_service_equals_the_command(
    served: ServerProcess, folder: Path, by_command: tuple[Path, dict]
) -> None:
    with served.client() as client:
        run = {"kind": "run", "parameters": {"stages": ["mapolas"]}}
        job = client.post("/api/v1/workspaces/ball/jobs", json=run).json()
        last, states = "0", []
        while "finished" not in states:
            # The connection is closed after each state; the next one goes on where it ended.
            headers = {"Last-Event-ID": last}
            with client.stream("GET", f"/api/v1/events?job={job['id']}", headers=headers) as lines:
                for line in lines.iter_lines():
                    if line.startswith("id:"):
                        assert int(line[3:]) > int(last)
                        last = line[3:].strip()
                    elif line.startswith("event:"):
                        kind = line[6:].strip()
                    elif line.startswith("data:") and kind == "state":
                        states.append(json.loads(line[5:])["state"])
                        break
        assert states == ["waiting", "running", "finished"]
        done = client.get(f"/api/v1/jobs/{job['id']}").json()
        assert done["result"]["stages"][0]["summary"] == by_command[1]["summary"]
        wanted = files_in(by_command[0])
        assert files_in(folder / "ball") == wanted
        listed = client.get("/api/v1/workspaces/ball/mapolas").json()
        name = listed["mapolas"][0]["name"]
        file = client.get(f"/api/v1/workspaces/ball/files/mapolas/{name}.MAP")
        assert file.content == (by_command[0] / "mapolas" / f"{name}.MAP").read_bytes()
        assert client.get(f"/api/v1/jobs/{job['id']}/log").json()["lines"]
        overview = client.get("/api/v1/workspaces/ball").json()
        assert overview["name"] == "ball"


def test_what_arrives_before_a_connection_breaks_is_kept(
    served: ServerProcess,
) -> None:
    url = httpx.URL(served.url)
    asked = {"name": "a.las", "size": len(PART), "sha256": "0" * 64, "kind": "scan"}
    with served.client() as client:
        place = client.post("/api/v1/workspaces/ball/uploads", json=asked).headers["location"]
        with socket.create_connection((url.host, url.port)) as broken:
            head = {
                "Host": "localhost",
                "Upload-Offset": "0",
                "Content-Type": "application/offset+octet-stream",
                "Content-Length": str(len(PART)),
                "Expect": "100-continue",
            }
            lines = [f"PATCH {place} HTTP/1.1", *(f"{key}: {head[key]}" for key in head), "", ""]
            broken.sendall("\r\n".join(lines).encode())
            assert b"100 Continue" in broken.recv(1000)
            broken.sendall(PART[:100])
            time.sleep(0.2)
        offsets = (client.head(place).headers["upload-offset"] for _ in range(100))
        assert "100" in offsets
        headers = {"Upload-Offset": "100", "Content-Type": "application/offset+octet-stream"}
        assert client.patch(place, content=PART[100:], headers=headers).status_code == 204


@pytest.mark.parametrize(
    "begin",
    [
        b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Endless: ",
        b"GET /",
        b"POST /api/v1/workspaces/ball/jobs HTTP/1.1\r\nHost: localhost\r\n"
        b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\nX-Endless: ",
    ],
    ids=["header", "address", "after the body"],
)
def test_who_sends_headers_without_end_fills_no_memory(served: ServerProcess, begin: bytes) -> None:
    url = httpx.URL(served.url)
    with socket.create_connection((url.host, url.port)) as connection:
        connection.sendall(begin)
        with pytest.raises(OSError, match=r"reset|Broken pipe"):
            connection.sendall(bytes(100_000_000).replace(b"\0", b"a"))
    with served.client() as client:
        assert client.get("/health").status_code == 200


def test_tokens_and_backups_while_it_runs_and_an_orderly_end(
    served: ServerProcess, folder: Path, tmp_path: Path
) -> None:
    assert "another spcola serve serves this folder" in refused("serve", folder, "--port", 0)
    made = called("serve", "token", "add", folder, "ann", "--scope", "run", "--workspace", "ball")
    (listed,) = called("serve", "token", "list", folder)["tokens"]
    assert (listed["id"], listed["scopes"]) == (made["id"], {"ball": "run"})
    headers = {"Authorization": f"Bearer {made['secret']}"}
    backup = tmp_path / "store.sqlite"
    with served.client() as client:
        assert client.get("/api/v1/jobs", headers=headers).status_code == 200
        assert client.get("/api/v1/tokens", headers=headers).status_code == 403
        jobs = client.get("/api/v1/jobs").json()
        called("serve", "backup", folder, backup)
        called("serve", "token", "revoke", folder, made["id"])
        called("serve", "restore", folder, backup)
        assert client.get("/api/v1/jobs").json() == jobs
        assert called("serve", "token", "list", folder)["tokens"][0]["revoked"]
        with client.stream("GET", "/api/v1/events") as events:
            # A stream that is open does not keep the server from ending.
            next(events.iter_lines())
            assert served.stop() == 0
    log = (folder / ".service" / "logs" / "server.jsonl").read_text().splitlines()
    lines = [json.loads(line) for line in log]
    assert any(line.get("path") == "/api/v1/jobs" and line["status"] == 200 for line in lines)
    assert lines[-1]["event"] == "drained"
