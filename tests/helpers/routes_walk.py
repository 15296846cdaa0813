"""Every route that reads, asked about a real workspace."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import Any

import httpx

from fusion.service.api.access import rules_of

BASE = "/api/v1/workspaces/{workspace}"
QUERIES = {
    "outlines": "kind=maplet",
    "window": "layer=height&rows=9&columns=9",
    "value": "x=0&y=0",
    "profile": "from=-1,0&to=1,0",
    "coverage": "step_deg=30",
    "shape": "facets=1000",
    "{layer}": "facets=1000",
}
MOST = 3


def urls(client: Any, workspace: str) -> Iterator[tuple[str, str]]:
    """Yield each route that reads but streams, and addresses of it with what is there."""
    base = BASE.replace("{workspace}", workspace)
    there = names_there(client, base)
    for method, route in rules_of(client.app):
        if method != "GET" or route.endswith("/events"):
            continue
        for values in islice(there.get(route, [{}]), MOST * 4):
            url = route.replace("{workspace}", workspace).replace(":path", "")
            for name, value in values.items():
                url = url.replace(f"{{{name}}}", value) if f"{{{name}}}" in url else url
            more = "&".join(f"{k}={v}" for k, v in values.items() if f"{{{k}" not in route)
            query = "&".join(filter(None, (QUERIES.get(route.rpartition("/")[2], ""), more)))
            if "{" not in url:
                yield route, f"{url}?{query}" if query else url


def names_there(client: Any, base: str) -> dict[str, list[dict[str, str]]]:
    """Return values for the parameters in the paths, as the lists of the service have them."""

    def listed(path: str, key: str) -> list[Any]:
        return client.get(f"{base}/{path}").json()[key]

    runs = [one["id"] for one in listed("runs", "runs")]
    outputs = [run for one in runs for run in client.get(f"{base}/runs/{one}").json()["outputs"]]
    products = {re.sub(r"\d+", "", name): name for name in outputs}
    surfaces = {one["kind"]: one["name"] for one in listed("surfaces", "surfaces")}
    solutions = [one["name"] for one in listed("solutions", "solutions")]
    found: dict[str, list[dict[str, str]]] = {
        "/runs/{run}": [{"run": one} for one in runs],
        "/runs/{first}/diff/{second}": [{"first": a, "second": b} for a, b in pairwise(runs)],
        "/provenance": [{"product": name} for name in products.values()],
        "/solutions/{name}": [{"name": one} for one in solutions],
        "/solutions/{first}/diff/{second}": [{"first": solutions[0], "second": solutions[-1]}],
        "/photoclinometry/{maplet}": [{"maplet": "AA0001"}],
        "/photoclinometry/{maplet}/{image}": [{"maplet": "AA0001", "image": "I1"}],
        "/tables/{name}": [{"name": one} for one in listed("tables", "tables")],
        "/results/{name}": [{"name": one} for one in ("registration", "scale", "manifest")],
        "/files/{path:path}": [{"path": one} for one in (*products.values(), "spcola.toml")],
        "/outputs/{path:path}": [{"path": one["name"]} for one in listed("outputs", "outputs")],
        "/shape/layers/{layer}": [
            {"layer": one["name"]} for one in listed("shape/layers", "layers")
        ],
        "/uploads/{upload}": [{"upload": one["id"]} for one in listed("uploads", "uploads")],
    }
    surface = [{"kind": kind, "name": name} for kind, name in surfaces.items()]
    for part in ("", "/window", "/value", "/profile", "/colours"):
        found[f"/surfaces/{{kind}}/{{name}}{part}"] = surface
    tile = {"level": "1", "row": "0", "column": "0"}
    found["/surfaces/{kind}/{name}/tiles/{level}/{row}/{column}"] = [one | tile for one in surface]
    by_route = {f"{BASE}{path}": values for path, values in found.items()}
    jobs = [{"job": one["id"]} for one in client.get("/api/v1/jobs").json()["jobs"]]
    page = [{"path": "main.js"}]
    return by_route | {
        "/api/v1/jobs/{job}": jobs, "/api/v1/jobs/{job}/log": jobs, "/static/{path:path}": page
    }  # fmt: skip


def answers(client: Any, workspace: str, **options: Any) -> Iterator[tuple[str, httpx.Response]]:
    """Ask all of them; yield each route with its answer."""
    for route, url in urls(client, workspace):
        yield route, client.get(url, **options)
