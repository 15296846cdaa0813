"""Who may do what: the table of all routes, scopes and workspaces, and what comes before it."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from asgi_client import AsgiClient
from fastapi import FastAPI

from fusion.service.api import Entrance, Limits, Service, create_app
from fusion.service.api.access import READ, Reach, Routes, Rule, rules_of
from fusion.service.jobs import JobKind, JobRequest
from fusion.service.store import Scope

PUBLIC = {("GET", "/health"), ("GET", "/ready"), ("GET", "/"), ("GET", "/static/{path:path}")}
HOLDERS = [(scope, place) for scope in Scope for place in ("ball", "other", "*")]


@pytest.fixture
def guarded(service: Service) -> Iterator[AsgiClient]:
    """Asks over the network: a token is needed."""
    service.limits = Limits(failures_per_s=0.001, failure_burst=2)
    entrance = Entrance.of("192.0.2.7", ("spc.example",))
    with AsgiClient(create_app(service, entrance), base_url="http://spc.example") as asking:
        yield asking


def bearer(service: Service, scope: Scope, place: str) -> dict[str, str]:
    secret, _ = service.store.tokens.make("ann", {place: scope})
    return {"Authorization": f"Bearer {secret}"}


def allowed(rule: Rule, scope: Scope, place: str) -> bool:
    """Return whether a token for `place` is enough for something of the workspace `ball`."""
    if rule.reach in (Reach.PUBLIC, Reach.KNOWN):
        return True
    enough = list(Scope).index(scope) >= list(Scope).index(rule.scope)
    return enough and (place == "*" or (place == "ball" and rule.reach is not Reach.EVERYWHERE))


def test_rules_follow_from_the_paths(client: AsgiClient) -> None:
    rules = rules_of(client.app)
    assert len(rules) > 50
    assert {route for route, rule in rules.items() if rule.reach is Reach.PUBLIC} == PUBLIC
    for (method, path), rule in rules.items():
        if "{workspace}" in path:
            assert rule.reach is Reach.WORKSPACE, path
        if "{job}" in path:
            assert rule.reach is Reach.JOB, path
        if method not in ("GET", "HEAD"):
            assert rule.scope in (Scope.RUN, Scope.ADMIN), path
        if "/tokens" in path or "/audit" in path:
            assert rule == Rule(Reach.EVERYWHERE, Scope.ADMIN), path


def test_every_route_for_every_scope(service: Service, guarded: AsgiClient) -> None:
    service.limits = Limits()
    job = service.store.submit(JobRequest(JobKind.RUN, "ball", "bob"))
    headers = {holder: bearer(service, *holder) for holder in HOLDERS}
    asked = 0
    for (method, path), rule in rules_of(guarded.app).items():
        named = path.replace("{workspace}", "ball").replace("{job}", job.id)
        url = re.sub(r"{\w+(:path)?}", "x", named)
        # A stream would not end; this is refused after access was granted.
        more = {"Last-Event-ID": "x"} if path.endswith("/events") else {}
        answer = guarded.request(method, url, headers=more)
        assert (answer.status_code == 401) == (rule.reach is not Reach.PUBLIC), (method, path)
        for holder in HOLDERS:
            answer = guarded.request(method, url, headers={**headers[holder], **more})
            code = "" if method == "HEAD" else str(answer.json().get("code", "")) if (
                "json" in answer.headers.get("content-type", "")
            ) else ""  # fmt: skip
            unseen = rule.reach is Reach.JOB and code == "unknown-job"
            refused = answer.status_code in (401, 403) or unseen
            assert refused != allowed(rule, *holder), (method, path, holder, answer.text)
            asked += 1
    assert asked == len(rules_of(guarded.app)) * len(HOLDERS)


def test_lists_hold_what_may_be_read(service: Service, guarded: AsgiClient) -> None:
    for name in ("ball", "other"):
        service.store.submit(JobRequest(JobKind.RUN, name, "bob"))
    mine = bearer(service, Scope.READ, "other")
    assert [
        one["workspace"] for one in guarded.get("/api/v1/jobs", headers=mine).json()["jobs"]
    ] == ["other"]
    found = guarded.get("/api/v1/workspaces", headers=mine).json()
    assert found == {"workspaces": [{"name": "other"}]}
    assert guarded.get("/api/v1/events?workspace=ball", headers=mine).status_code == 403
    compared = "/api/v1/workspaces/other/runs/a/diff/b?other=ball"
    assert guarded.get(compared, headers=mine).status_code == 403
    after = {"kind": "run", "after": [service.store.jobs(workspaces=["ball"])[0].id]}
    runs = bearer(service, Scope.RUN, "other")
    answer = guarded.post("/api/v1/workspaces/other/jobs", headers=runs, json=after)
    assert answer.json()["code"] == "unknown-job"


def test_a_route_without_a_rule_is_refused_at_the_start(service: Service) -> None:
    app = FastAPI(openapi_url=None)
    routes = Routes("", "test")
    routes.add("GET", "/{workspace}", READ)(lambda: None)
    routes.add_to(app)
    assert rules_of(app) == {("GET", "/{workspace}"): READ}
    app.add_api_route("/open", lambda: None)
    with pytest.raises(TypeError, match="/open declares no rule"):
        rules_of(app)


def test_tokens_are_revoked_expire_and_cannot_be_guessed(
    service: Service, guarded: AsgiClient
) -> None:
    admin = bearer(service, Scope.ADMIN, "*")
    made = guarded.post(
        "/api/v1/tokens", headers=admin, json={"user": "eve", "scopes": {"ball": "read"}}
    )
    assert made.status_code == 201
    hers = {"Authorization": f"Bearer {made.json()['secret']}"}
    assert guarded.get("/api/v1/jobs", headers=hers).status_code == 200
    assert guarded.delete(made.headers["location"], headers=admin).status_code == 204
    refused = guarded.get("/api/v1/jobs", headers=hers)
    assert refused.status_code == 401
    assert refused.headers["www-authenticate"] == "Bearer"
    assert "secret" not in guarded.get("/api/v1/tokens", headers=admin).text
    for _ in range(2):
        last = guarded.get("/api/v1/jobs", headers={"Authorization": "Bearer guess"})
    assert last.status_code == 429
    assert int(last.headers["retry-after"]) > 100
    done = guarded.get("/api/v1/audit", headers=admin).json()["entries"]
    assert [one["action"] for one in done] == ["revoke_token", "make_token"]
    assert all(one["user"] == "ann" and one["details"]["token"] for one in done)


def test_other_sites_and_other_names_are_refused(client: AsgiClient) -> None:
    run = {"url": "/api/v1/workspaces/ball/jobs", "json": {"kind": "run"}}
    assert client.get("/health", headers={"Host": "rebound.example"}).status_code == 421
    for headers in (
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
    ):
        assert client.post(**run, headers=headers).json()["code"] == "cross-site"
    own = {"Origin": "http://localhost", "Sec-Fetch-Site": "same-origin"}
    assert client.post(**run, headers=own).status_code == 202
    # A form of another site has no JSON.
    form = {"content": b'{"kind": "run"}', "headers": {"Content-Type": "text/plain"}}
    assert client.post(run["url"], **form).status_code == 422


def test_every_answer_has_the_safe_headers(service: Service, client: AsgiClient) -> None:
    for path in ("/health", "/api/v1/jobs/none", "/nowhere"):
        headers = client.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert "default-src 'self'" in headers["content-security-policy"]
        assert "strict-transport-security" not in headers
        assert headers["x-request-id"]
    with AsgiClient(create_app(service), base_url="https://localhost") as secure:
        assert "max-age" in secure.get("/health").headers["strict-transport-security"]


def test_requests_have_a_rate(service: Service) -> None:
    service.limits = Limits(requests_per_s=0.01, request_burst=2)
    with AsgiClient(
        create_app(service, Entrance.of("192.0.2.7")), base_url="http://192.0.2.7"
    ) as asking:
        mine = bearer(service, Scope.READ, "*")
        codes = [asking.get("/api/v1/jobs", headers=mine).status_code for _ in range(3)]
        assert codes == [200, 200, 429]
        # Another token has a rate of its own.
        other = bearer(service, Scope.READ, "*")
        assert asking.get("/api/v1/jobs", headers=other).status_code == 200


@pytest.mark.parametrize(
    ("host", "names", "needed"),
    [
        ("127.0.0.1", (), False),
        ("localhost", (), False),
        ("::1", (), False),
        ("0.0.0.0", (), True),
        ("::", (), True),
        ("192.0.2.7", (), True),
        ("127.0.0.1", ("spc.example",), True),
    ],
)
def test_only_loopback_needs_no_token(host: str, names: tuple[str, ...], needed: bool) -> None:
    assert Entrance.of(host, names).token_needed is needed
