"""Uploads in parts: resumed, checked, kept to their folder, limited."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import replace

import pytest
from asgi_client import AsgiClient

from fusion.service.api import Service, create_app
from fusion.service.api.errors import RequestRefusedError
from fusion.service.api.upload_file import clean_name
from fusion.service.state import outputs_folder

CONTENT = bytes(range(256)) * 20
PART = {"Content-Type": "application/offset+octet-stream"}
PLACE = "/api/v1/workspaces/ball/uploads"


def begun(client: AsgiClient, content: bytes = CONTENT, **changed: object) -> str:
    digest = hashlib.sha256(content).hexdigest()
    asked = {"name": "scan.h5", "size": len(content), "sha256": digest, "kind": "scan"}
    answer = client.post(PLACE, json=asked | changed)
    assert answer.status_code == 201, answer.text
    assert answer.headers["upload-offset"] == "0"
    return answer.headers["location"]


def send(client: AsgiClient, place: str, offset: int, content: bytes) -> int:
    headers = {**PART, "Upload-Offset": str(offset)}
    return client.patch(place, content=content, headers=headers).status_code


def test_an_upload_is_resumed_and_completed(service: Service, client: AsgiClient) -> None:
    place = begun(client, name="../../etc/.odd näme.h5")
    assert send(client, place, 0, CONTENT[:1000]) == 204
    assert client.post(f"{place}/complete").json()["code"] == "wrong-offset"
    # The client lost the answer and sends the part again: the offset is what the service has.
    assert send(client, place, 0, CONTENT[:1000]) == 409
    there = int(client.head(place).headers["upload-offset"])
    assert there == 1000
    # What a killed server wrote but did not note is written again.
    folder = service.uploads / place.rpartition("/")[2]
    with (folder / "part").open("ab") as part:
        part.write(b"not noted")
    assert send(client, place, there, CONTENT[there:]) == 204
    done = client.post(f"{place}/complete").json()
    assert (done["state"], done["name"]) == ("complete", "odd_n_me.h5")
    assert (folder / "file" / done["name"]).read_bytes() == CONTENT
    assert client.post(f"{place}/complete").json()["state"] == "complete"
    assert send(client, place, len(CONTENT), b"more") == 409
    assert client.delete(place).status_code == 204
    assert not folder.exists()


def test_a_wrong_checksum_is_refused_and_nothing_is_kept(
    service: Service, client: AsgiClient
) -> None:
    place = begun(client)
    assert send(client, place, 0, CONTENT[:-1] + b"!") == 204
    refused = client.post(f"{place}/complete")
    assert (refused.status_code, refused.json()["code"]) == (422, "wrong-checksum")
    assert client.head(place).status_code == 404
    assert not list(service.uploads.iterdir())


def test_uploads_have_limits_and_belong_to_one_workspace(client: AsgiClient) -> None:
    place = begun(client)
    assert send(client, place, 0, CONTENT + b"!") == 413
    assert client.patch(place, content=b"x", headers={"Upload-Offset": "0"}).status_code == 415
    assert client.head(place.replace("/ball/", "/other/")).status_code == 404
    asked = {"name": "a", "size": 10_001, "sha256": "0" * 64, "kind": "scan"}
    assert client.post(PLACE, json=asked).json()["code"] == "too-large"
    begun(client)
    begun(client)
    assert client.post(PLACE, json=asked | {"size": 1}).json()["code"] == "over-quota"
    assert len(client.get(PLACE).json()["uploads"]) == 3


def test_users_workspaces_and_the_disk_have_room_for_so_much(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.limits = replace(service.limits, user_quota_bytes=15_000, quota_bytes=12_000)
    asked = {"name": "a", "size": 8000, "sha256": "0" * 64, "kind": "scan"}
    places = [PLACE.replace("ball", name) for name in ("ball", "other")]
    with AsgiClient(create_app(service)) as client:

        def refusal(place: str, size: int) -> tuple[str, str]:
            answer = client.post(place, json=asked | {"size": size}).json()
            return answer["code"], answer.get("where", "")

        first = client.post(places[0], json=asked).headers["location"]
        assert refusal(places[0], 4001) == ("over-quota", "ball")
        assert refusal(places[1], 7001) == ("over-quota", "local")
        # An upload that is removed takes no room.
        assert client.delete(first).status_code == 204
        assert client.post(places[0], json=asked).status_code == 201
        # The disk has to have room for what open uploads have announced, too.
        usage = shutil._ntuple_diskusage(1 << 40, 0, (1 << 28) + 9000)
        monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
        assert refusal(places[1], 1001)[0] == "disk-full"
        assert client.post(places[1], json=asked | {"size": 1000}).status_code == 201


def test_jobs_that_write_outputs_are_refused_beyond_the_quota(service: Service) -> None:
    service.limits = replace(service.limits, outputs_bytes=100)
    jobs = PLACE.replace("uploads", "jobs")
    export = {"kind": "solution-export", "parameters": {"name": "imported", "folder": "again"}}
    kept = outputs_folder(service.root, "ball") / "spc" / "all.txt"
    kept.parent.mkdir(parents=True)
    kept.write_bytes(b"x" * 99)
    with AsgiClient(create_app(service)) as client:
        assert client.post(jobs, json=export).status_code == 202
        kept.write_bytes(b"x" * 100)
        answer = client.post(jobs, json=export)
        problem = answer.json()
        assert (answer.status_code, problem["code"]) == (413, "over-quota")
        assert (problem["where"], problem["do"]) == ("ball", "download and remove some")
        assert "100 bytes" in problem["detail"]
        # What writes no outputs, and another workspace, are not concerned.
        run = {"kind": "run", "parameters": {"stages": ["mapolas"]}}
        assert client.post(jobs, json=run).status_code == 202
        assert client.post(jobs.replace("ball", "other"), json=export).status_code == 202
        assert client.delete(PLACE.replace("uploads", "outputs/spc")).status_code == 204
        assert client.post(jobs, json=export).status_code == 202


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("scan.h5", "scan.h5"),
        ("..\\..\\boot.ini", "boot.ini"),
        (".hidden", "hidden"),
        ("a\0b\n.h5", "a_b_.h5"),
        ("-rf.DAT", "rf.DAT"),
        ("x" * 300 + ".MAP", "x" * 112 + ".MAP"),
    ],
)
def test_names_are_cleaned(given: str, name: str) -> None:
    assert clean_name(given) == name


def test_a_name_of_nothing_is_refused() -> None:
    with pytest.raises(RequestRefusedError):
        clean_name("../..")
