"""The described interface is what answers, and no input of its kinds makes it fail."""

from __future__ import annotations

from pathlib import Path

import pytest
from answer_check import faults_of
from asgi_client import AsgiClient
from hypothesis import HealthCheck, Phase, given, settings

from fusion.service.api.access import rules_of
from fusion.service.jobs import JobKind

schemathesis = pytest.importorskip("schemathesis")
EXAMPLES = 3
"""Inputs for each operation; ``scripts/test`` has no time for more."""
THERE = {"workspace": "ball", "kind": "maplet", "name": "AA0001"}
"""What the paths name in two of three inputs; ``scripts/bench/service`` tries thousands."""


def test_the_description_is_whole(client: AsgiClient) -> None:
    described = client.get("/api/v1/openapi.json").json()
    operations = {
        (method.upper(), path): content
        for path, methods in described["paths"].items()
        for method, content in methods.items()
    }
    unseen = {"/", "/static/{path:path}"}
    known = {(m, p.replace(":path", "")) for m, p in rules_of(client.app) if p not in unseen}
    assert operations.keys() == known
    assert all(content["description"] for content in operations.values())
    bodies = [name for name in described["components"]["schemas"] if name.endswith("Request")]
    assert bodies
    for name in bodies:
        assert described["components"]["schemas"][name]["examples"], name


def test_the_reference_has_every_route_and_every_kind(client: AsgiClient) -> None:
    docs = Path(__file__).parents[4] / "docs" / "reference"
    described, kinds = ((docs / name).read_text() for name in ("http.md", "jobs.md"))
    for method, path in rules_of(client.app):
        assert f"`{method} {path.replace(':path', '')}`" in described
    for kind in JobKind:
        assert f"| `{kind.value}` |" in kinds


def test_no_input_of_the_described_kinds_fails(client: AsgiClient) -> None:
    described = client.get("/api/v1/openapi.json").json()
    schema = schemathesis.openapi.from_dict(described)
    tried = 0
    for found in schema.get_all_operations():
        operation = found.ok()
        if operation.path.endswith("/events"):
            continue

        @settings(
            max_examples=EXAMPLES,
            deadline=None,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy())
        def ask(case: schemathesis.Case) -> None:
            nonlocal tried
            tried += 1
            if tried % 3:
                there = THERE.keys() & case.path_parameters.keys()
                case.path_parameters.update({name: THERE[name] for name in there})
            # Of the transport of requests; httpx has the same names.
            asked = case.as_transport_kwargs(base_url="http://localhost")
            known = {"method", "url", "headers", "params", "json", "content"}
            asked["content"] = asked.pop("data", None)
            answer = client.request(**{key: asked[key] for key in known & asked.keys()})
            assert answer.status_code < 500, (case, answer.text)
            wrong = faults_of(described, case.method, case.path, answer)
            assert not wrong, (case, wrong)

        ask()
    # The number of inputs that were tried.
    assert tried > 100
