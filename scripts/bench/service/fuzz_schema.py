"""Inputs of the described kinds for every operation of the interface: none may give a 5xx.

    python -m scripts.bench.service.fuzz_schema [--examples 200] [--seed 0]

A real server process is asked over HTTP by schemathesis; streams of events are left out. The suite
does the same with 3 examples in one process (`tests/fusion/service/api/test_schema.py`).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import httpx
import numpy as np
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded

sys.path.insert(0, str(Path(__file__).parents[3] / "tests" / "helpers"))
from server_process import ServerProcess

from fusion.workspace import new_workspace
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid

THERE = {"workspace": "ball", "kind": "maplet", "name": "AA0001"}
"""What the paths name in three of four inputs."""


def main() -> int:
    """Print the number of inputs and of answers by status; return 1 if one was a 5xx."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--examples", type=int, default=200, help="of each operation")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    answers: Counter[int] = Counter()
    wrong: list[str] = []
    begun, operations = time.monotonic(), 0
    with tempfile.TemporaryDirectory() as folder:
        new_workspace(Path(folder, "ball"), body="Ball")
        grid = MapletGrid.facing([60.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 12)
        maplet = Maplet("AA0001", grid, np.zeros(grid.shape))
        write_maplet(Path(folder, "ball", "MAPFILES", "AA0001.MAP"), maplet)
        server = ServerProcess(Path(folder), "--workers", "0")
        try:
            with server.client() as client:
                described = client.get("/api/v1/openapi.json").json()
                for found in schemathesis.openapi.from_dict(described).get_all_operations():
                    operation = found.ok()
                    if operation.path.endswith("/events"):
                        continue
                    operations += 1
                    ask = seeded(options.seed)(asking(client, operation, options, answers, wrong))
                    ask()
                alive = client.get("/health").status_code == 200
        finally:
            server.kill()
    total = sum(answers.values())
    print(f"{total} inputs for {operations} operations in {time.monotonic() - begun:.0f} s")
    print(
        "answers: " + ", ".join(f"{count} × {status}" for status, count in sorted(answers.items()))
    )
    print(f"5xx: {len(wrong)} (limit 0); the server answers at the end: {alive}")
    for one in wrong[:10]:
        print(f"    {one}")
    return int(bool(wrong) or not alive)


def asking(client: httpx.Client, operation, options, answers: Counter[int], wrong: list[str]):
    """Return a property of hypothesis that asks one operation."""

    @settings(
        max_examples=options.examples,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=operation.as_strategy())
    def ask(case: schemathesis.Case) -> None:
        if sum(answers.values()) % 4:
            # Of names that are not there, no more than that is found out.
            there = {name: THERE[name] for name in THERE.keys() & case.path_parameters.keys()}
            case.path_parameters.update(there)
        asked = case.as_transport_kwargs(base_url=str(client.base_url).rstrip("/"))
        known = {"method", "url", "headers", "params", "json", "content"}
        asked["content"] = asked.pop("data", None)
        try:
            answer = client.request(**{key: asked[key] for key in known & asked.keys()})
        except (httpx.InvalidURL, httpx.LocalProtocolError, UnicodeEncodeError):
            answers[0] += 1  # the client itself refuses to send it
            return
        answers[answer.status_code] += 1
        if answer.status_code >= 500:
            wrong.append(f"{case.method} {case.path}: {answer.status_code} {answer.text[:200]}")

    return ask


if __name__ == "__main__":
    sys.exit(main())
