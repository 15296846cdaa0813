"""A PostgreSQL server that stops and starts again under a service that is used."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from damage import files_in
from postgresql import find_program, postgresql_server
from server_process import ASKING_S, ServerProcess, wait_for

JOBS = "/api/v1/workspaces/ball/jobs"


def test_a_restart_costs_retries_and_nothing_else(
    serve: Callable[..., ServerProcess], missions: Path, by_command: tuple[Path, dict]
) -> None:
    if find_program("initdb") is None:
        pytest.skip("no PostgreSQL server is installed; on Debian: apt-get install postgresql")
    answers: Counter[int] = Counter()
    odd: list[object] = []
    acknowledged: dict[str, str] = {}
    over = threading.Event()

    def use(number: int) -> None:
        with server.client() as client:
            for turn in range(10_000):
                if over.is_set():
                    return
                key = f"{number}-{turn}"
                later = {"kind": "forecast", "priority": -100, "after": [job]}
                found = [
                    client.get(f"/api/v1/jobs/{job}"),
                    client.get(f"{JOBS}?limit=20"),
                    client.post(JOBS, json=later, headers={"Idempotency-Key": key}),
                ]
                answers.update(one.status_code for one in found)
                for one in found:
                    retried = one.status_code == 503 and "retry-after" in one.headers
                    if one.status_code not in (200, 202) and not retried:
                        odd.append(one.text)
                if found[2].status_code == 202:
                    acknowledged[key] = found[2].json()["id"]
                time.sleep(ASKING_S)

    with postgresql_server() as postgresql:
        server = serve("--store", postgresql.new_database("store"))
        with server.client() as client:
            run = {"kind": "run", "parameters": {"stages": ["mapolas"]}}
            job = client.post(JOBS, json=run).json()["id"]
            users = [threading.Thread(target=use, args=(number,)) for number in range(3)]
            for user in users:
                user.start()
            wait_for(lambda: any((missions / "ball" / ".items").glob("*/[!.]*.npz")))
            for _ in range(2):
                postgresql.stop()
                time.sleep(0.5)
                postgresql.start()
                time.sleep(0.5)
            wait_for(
                lambda: client.get(f"/api/v1/jobs/{job}").json().get("state") == "finished",
                every=ASKING_S,
            )
            over.set()
            for user in users:
                user.join()
            done = client.get(f"/api/v1/jobs/{job}").json()
            # Each acknowledged request is there once.
            found, url = [], f"{JOBS}?limit=1000"
            while url:
                page = client.get(url)
                found += [one["id"] for one in page.json()["jobs"]]
                url = page.links.get("next", {}).get("url", "")
        server.stop()
    assert odd == []
    assert answers[503] > 0
    assert answers[202] > 0
    assert len(set(found)) == len(found)
    assert set(acknowledged.values()) <= set(found)
    assert done["tries"] == 1
    assert files_in(missions / "ball") == files_in(by_command[0])
