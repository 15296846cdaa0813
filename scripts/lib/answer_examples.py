"""Writes the examples of answers in the description of the interface.

Asks a service in this process about the workspaces of a folder, of which one has all results:
``python scripts/lib/answer_examples.py DIR WORKSPACE``. A test compares them with other answers.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CHECKOUT / "tests" / "helpers"))

from asgi_client import AsgiClient  # noqa: E402
from routes_walk import answers  # noqa: E402
from served import Service as Served  # noqa: E402

from fusion.service.api import Service, create_app  # noqa: E402
from fusion.service.jobs import JobKind  # noqa: E402
from fusion.service.store import Store  # noqa: E402

TARGET = CHECKOUT / "fusion" / "service" / "api" / "schemas" / "examples.json"
_ITEMS, _KEYS, _LONGEST = 2, 40, 120
_NAMED = 8
"""An object with more keys than this, far in, is a mapping by names: two of them show it."""


def shortened(value: Any, depth: int = 0) -> Any:
    """Return JSON with the first entries of its lists and mappings."""
    if isinstance(value, dict):
        names = list(value)[: 2 if depth and len(value) > _NAMED and _alike(value) else _KEYS]
        return {name: shortened(value[name], depth + 1) for name in names}
    if isinstance(value, list):
        return [shortened(one, depth + 1) for one in value[: 3 if _plain(value) else _ITEMS]]
    return value[:_LONGEST] if isinstance(value, str) else value


def _alike(value: dict[str, Any]) -> bool:
    return len({type(one) for one in value.values()}) == 1


def _one_path(described: dict[str, Any]) -> dict[str, Any]:
    path = "/health"
    return {"openapi": described["openapi"], "paths": {path: described["paths"][path]}}


def _length(value: Any) -> int:
    return len(json.dumps(value))


def _plain(value: list[Any]) -> bool:
    return all(isinstance(one, int | float) for one in value[:3])


def main(folder: Path, workspace: str) -> None:
    """Ask all routes that read, and those that write an answer of their own."""
    found: dict[str, Any] = {}
    with Store(folder / ".service" / "store.sqlite") as store:
        service = Service(folder, store)
        worked = Served(folder, store)
        worked.submit_to(workspace, JobKind.SOLUTION_EXPORT, name="imported", folder="spc")
        worked.work()
        with AsgiClient(create_app(service)) as client:
            _write(client, found, workspace)
            # Of several answers the longest shows most.
            for route, answer in answers(client, workspace):
                name = f"GET {route.replace(':path', '')}"
                kind = answer.headers.get("content-type", "").partition(";")[0]
                if answer.status_code == 200 and kind == "application/json":
                    several = [found[name]] if name in found else []
                    found[name] = max([*several, shortened(answer.json())], key=_length)
            found["problem"] = client.get(f"/api/v1/workspaces/{workspace}/results/none").json()
            found["GET /api/v1/openapi.json"] = _one_path(client.get("/api/v1/openapi.json").json())
    for name in [one for one in found if "/files/" in one or "/outputs/{path}" in one]:
        del found[name]
    lines = (f" {json.dumps(name)}: {json.dumps(found[name])}" for name in sorted(found))
    TARGET.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def _write(client: Any, found: dict[str, Any], workspace: str) -> None:
    """Ask the routes that write; what they made is there for those that read."""
    base = f"/api/v1/workspaces/{workspace}"
    place = "/api/v1/workspaces/{workspace}"

    def sent(method: str, route: str, path: str = "", **options: Any) -> Any:
        answer = client.request(method, path or route.replace("{workspace}", workspace), **options)
        assert answer.status_code < 300, answer.text
        if answer.content:
            found[f"{method} {route}"] = shortened(answer.json())
        return answer

    asked = {"name": "scan01.dat", "size": 4, "kind": "scan"}
    asked["sha256"] = "88d4266fd4e6338d13b845fcf289579d209c897823b9217da3e161936f031589"
    upload = sent("POST", f"{place}/uploads", json=asked).json()["id"]
    headers = {"Upload-Offset": "0", "Content-Type": "application/octet-stream"}
    client.patch(f"{base}/uploads/{upload}", content=b"abcd", headers=headers)
    route = f"{place}/uploads/{{upload}}"
    sent("POST", f"{route}/complete", f"{base}/uploads/{upload}/complete")
    sent("DELETE", f"{place}/uploads")
    sent("POST", "/api/v1/workspaces", json={"name": "other", "body": "Other"})
    run = {"kind": JobKind.RUN.value, "parameters": {"stages": ["fuse"]}}
    job = sent("POST", f"{place}/jobs", json=run).json()["id"]
    sent("POST", f"{place}/forecast", json={"parameters": run["parameters"]})
    sent("POST", "/api/v1/jobs/{job}/cancel", f"/api/v1/jobs/{job}/cancel")
    token = {"user": "anna", "scopes": {workspace: "run"}, "name": "notebook", "days": 90}
    secret = sent("POST", "/api/v1/tokens", json=token).json()
    found["POST /api/v1/tokens"]["secret"] = "shown once"
    client.delete(f"/api/v1/tokens/{secret['id']}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
