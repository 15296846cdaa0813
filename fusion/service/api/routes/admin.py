"""Routes of who asks, and for administrators: tokens, and the audit log."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import Request
from starlette.responses import Response

from fusion.service.api.access import ADMIN, KNOWN, Routes, caller_of
from fusion.service.api.answers import json_answer
from fusion.service.api.pages import After, Limit, next_link, page_of
from fusion.service.api.schemas import work
from fusion.service.api.service import service_of
from fusion.service.store import Scope

routes = Routes("/api/v1", "administration")
_DAY_S = 86_400.0
_Name = Annotated[str, Field(min_length=1, max_length=64)]


class TokenRequest(BaseModel):
    """A token that is to be made."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [{"user": "anna", "scopes": {"bennu": "run"}, "name": "", "days": 90}]
        },
    )

    user: _Name = Field(description="In whose name it acts.")
    scopes: dict[_Name, Scope] = Field(
        min_length=1, max_length=1000, description="By workspace; those of * are for all."
    )
    name: str = Field(default="", max_length=64, description="What it is for.")
    days: float | None = Field(default=None, gt=0, le=36_500, description="Until it expires.")


@routes.add("GET", "/caller", KNOWN, work.Caller)
def caller(request: Request) -> Response:
    """Return who asks, and the scopes by workspace; those of * are for all."""
    asking = caller_of(request)
    return json_answer(request, {"user": asking.name, "scopes": dict(asking.token.scopes)})


@routes.add("GET", "/tokens", ADMIN, work.TOKENS)
def tokens(request: Request, after: After = "", limit: Limit = 100) -> Response:
    """List all tokens, without their secrets."""
    found = service_of(request).store.tokens.all()
    shown, more = page_of(request, found, after, limit, lambda token: token.id)
    return json_answer(request, {"tokens": [asdict(token) for token in shown]}, more)


@routes.add("POST", "/tokens", ADMIN, work.NEW_TOKEN, status_code=201)
def make_token(request: Request, body: TokenRequest) -> Response:
    """Make a token. Its secret is in this answer and never again."""
    secret, token = service_of(request).store.tokens.make(
        body.user,
        body.scopes,
        name=body.name,
        lifetime_s=None if body.days is None else body.days * _DAY_S,
    )
    headers = {"Location": f"{request.url.path}/{token.id}", "Cache-Control": "no-store"}
    answer = json_answer(request, {**asdict(token), "secret": secret}, headers)
    answer.status_code = 201
    return answer


@routes.add("DELETE", "/tokens/{token}", ADMIN, status_code=204)
def revoke_token(request: Request, token: str) -> Response:
    """Revoke a token from now on."""
    service = service_of(request)
    service.store.tokens.revoke(token)
    service.tokens.forget()
    return Response(status_code=204)


@routes.add("GET", "/audit", ADMIN, work.ENTRIES)
def audit(
    request: Request,
    workspace: Annotated[str, Query(max_length=64)] = "",
    user: Annotated[str, Query(max_length=64)] = "",
    before: Annotated[int, Query(ge=0, le=1 << 62)] = 0,
    limit: Limit = 100,
) -> Response:
    """List who did what, the newest first."""
    log = service_of(request).store.audit
    found = log.entries(before=before, workspace=workspace, user=user, limit=limit + 1)
    shown = found[:limit]
    more = next_link(request, "before", str(shown[-1].number)) if len(found) > limit else {}
    return json_answer(request, {"entries": [asdict(entry) for entry in shown]}, more)
