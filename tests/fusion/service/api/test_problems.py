"""Errors become problem documents; one that nobody foresaw says nothing about the machine."""

from __future__ import annotations

import errno
import logging
from collections.abc import Iterator

import pytest
from asgi_client import AsgiClient

from fusion.service.api import Service, create_app
from fusion.service.api.access import PUBLIC, Routes
from fusion.service.api.errors import CODES, Refusal
from fusion.service.api.problems import status_and_code
from fusion.service.faults import FAULTS
from fusion.service.store import StoreError, StoreFault
from spcola.errors import SpcolaError, WorkspaceError


def errors_below(kind: type[SpcolaError]) -> Iterator[type[SpcolaError]]:
    yield kind
    for one in kind.__subclasses__():
        yield from errors_below(one)


def test_every_error_and_every_code_has_a_status() -> None:
    assert CODES.keys() == {*Refusal, *StoreFault}
    for kind in errors_below(SpcolaError):
        assert any(base in FAULTS for base in kind.__mro__), kind
    assert {fault.status.value for fault in FAULTS.values()} <= {409, 422, 503}
    full = OSError(errno.ENOSPC, "full")
    wrapped = WorkspaceError("cannot be written")
    wrapped.__cause__ = full
    for error in (full, wrapped, StoreError(StoreFault.DISK_FULL, "full")):
        assert status_and_code(error) == (507, "disk-full")
    assert status_and_code(ValueError("any"))[0] == 500


def test_an_unforeseen_error_leaks_nothing_but_its_number(
    service: Service, caplog: pytest.LogCaptureFixture
) -> None:
    app = create_app(service)
    routes = Routes("", "test")

    @routes.add("GET", "/broken", PUBLIC)
    def broken() -> None:
        raise RuntimeError("/secret/place is broken")

    routes.add_to(app)
    with AsgiClient(app, base_url="http://localhost") as client, caplog.at_level(logging.ERROR):
        answer = client.get("/broken")
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert "secret" not in answer.text
    assert "Traceback" not in answer.text
    number = answer.headers["x-request-id"]
    assert answer.json()["instance"] == f"urn:spcola:request:{number}"
    logged = [record for record in caplog.records if getattr(record, "request", "") == number]
    assert any("/secret/place" in str(record.exc_info) for record in logged)


def test_problems_name_place_and_remedy_without_the_folder_of_the_service(
    service: Service, client: AsgiClient
) -> None:
    wrong = {"parameters": {"settings": {"mapolas": {"gsd_m": -1}}}}
    answer = client.post("/api/v1/workspaces/ball/jobs", json=wrong)
    assert (answer.status_code, answer.json()["code"]) == (422, "settings")
    assert answer.json()["where"] == "settings: [mapolas] gsd_m"
    (service.root / "ball" / "spcola.toml").write_text("[body]\nwrong = 1\n")
    answer = client.get("/api/v1/workspaces/ball")
    assert answer.json()["where"].startswith("ball/spcola.toml")
    assert str(service.root) not in answer.text
    for path, code in (
        ("/api/v1/workspaces/none", "not-found"),
        ("/api/v1/workspaces/..", "not-found"),
        ("/api/v1/jobs/none", "unknown-job"),
        ("/api/v1/workspaces/ball/surfaces/maplet/NONE", "not-found"),
        ("/api/v1/workspaces/ball/surfaces/other/NONE", "invalid-request"),
    ):
        assert client.get(path).json()["code"] == code, path
    assert client.put("/api/v1/jobs").json()["code"] == "method-not-allowed"
    paths = {"parameters": {"settings": {"register": {"apply": "/etc/passwd"}}}}
    assert client.post("/api/v1/workspaces/other/jobs", json=paths).status_code == 422
