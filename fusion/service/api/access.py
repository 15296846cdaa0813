"""Who asks, and what each route demands of them."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

from fastapi import Depends, FastAPI
from fastapi.routing import APIRoute
from pydantic import BaseModel
from starlette.requests import Request

from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.schemas import Media, responses_of
from fusion.service.store import Scope, Token, UnknownJobError
from fusion.service.store.records import ALL_WORKSPACES

LOCAL = "local"
"""Name of who asks from this machine without a token."""
Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])


@dataclass(frozen=True)
class Caller:
    """Who asks: a token, or without one the user of this machine; and from where."""

    token: Token
    address: str = ""

    @classmethod
    def local(cls, address: str) -> Caller:
        """Return who asks from this machine without a token: that user may do everything."""
        return cls(Token("", LOCAL, "", {ALL_WORKSPACES: Scope.ADMIN}, math.nan), address)

    @property
    def name(self) -> str:
        """Name of the user."""
        return self.token.user

    def may(self, scope: Scope, workspace: str = ALL_WORKSPACES) -> bool:
        """Return whether a scope is granted in a workspace; by default in all."""
        return self.token.permits(scope, workspace)


class Reach(StrEnum):
    """In which workspaces a rule demands its scope."""

    PUBLIC = "public"  # nobody need be known
    KNOWN = "known"  # anybody with a token; the answer holds only what they may read
    WORKSPACE = "workspace"  # the one in the path
    JOB = "job"  # that of the job in the path
    EVERYWHERE = "everywhere"  # all of them


@dataclass(frozen=True)
class Rule:
    """What a route demands: a scope, and where."""

    reach: Reach
    scope: Scope | None = None

    async def __call__(self, request: Request) -> None:
        """Refuse a request that the rule does not allow.

        A workspace that may not be read and one that is not there get the same answer, and so do
        their jobs.
        """
        if self.reach is Reach.PUBLIC:
            return
        caller = caller_of(request)
        if self.reach is Reach.KNOWN or self.scope is None:
            return
        name = ALL_WORKSPACES
        if self.reach is Reach.WORKSPACE:
            name = request.path_params["workspace"]
        elif self.reach is Reach.JOB:
            name = await self.check_job(request, request.path_params["job"])
        if not caller.may(self.scope, name):
            place = "all workspaces" if name == ALL_WORKSPACES else f"the workspace {name!r}"
            raise RequestRefusedError(
                Refusal.FORBIDDEN,
                f"this needs the scope {self.scope.value!r} for {place}",
                do="ask the administrator for a token with it",
            )

    async def check_job(self, request: Request, identity: str) -> str:
        """Return the workspace of a job; raises UnknownJobError if it may not be read."""
        workspace: str = await request.app.state.service.workspaces_of_jobs.find(identity)
        if not caller_of(request).may(Scope.READ, workspace):
            raise UnknownJobError(identity)
        return workspace


PUBLIC = Rule(Reach.PUBLIC)
KNOWN = Rule(Reach.KNOWN)
READ = Rule(Reach.WORKSPACE, Scope.READ)
RUN = Rule(Reach.WORKSPACE, Scope.RUN)
READ_JOB = Rule(Reach.JOB, Scope.READ)
RUN_JOB = Rule(Reach.JOB, Scope.RUN)
READ_ALL = Rule(Reach.EVERYWHERE, Scope.READ)
ADMIN = Rule(Reach.EVERYWHERE, Scope.ADMIN)


def caller_of(request: Request) -> Caller:
    """Return who asks; raises RequestRefusedError if nobody is known."""
    caller = request.scope.get("state", {}).get("caller")
    if not isinstance(caller, Caller):
        raise RequestRefusedError(
            Refusal.UNAUTHENTICATED, "a token is needed", do="send it: Authorization: Bearer TOKEN"
        )
    return caller


class Routes:
    """Routes of one subject, each with its rule.

    Parameters
    ----------
    prefix : str
        Of all paths.
    tag : str
        The subject, in the description of the interface.
    """

    def __init__(self, prefix: str, tag: str) -> None:
        self.prefix = prefix
        self.tag = tag
        self._added: list[tuple[str, Callable[..., Any], dict[str, Any]]] = []

    def add(
        self,
        method: str,
        path: str,
        rule: Rule,
        answer: type[BaseModel] | Media | None = None,
        **options: Any,
    ) -> Callable[[Endpoint], Endpoint]:
        """Return a decorator that adds a route with its answer; `options` are those of FastAPI."""

        def added(endpoint: Endpoint) -> Endpoint:
            status = options.get("status_code", 200)
            pages = "limit" in inspect.signature(endpoint).parameters
            tagged = options.pop("tagged", method == "GET")
            given = {
                "methods": [method],
                "dependencies": [Depends(rule)],
                "tags": [self.tag],
                **responses_of(answer, status, pages=pages, tagged=tagged),
                "openapi_extra": {
                    "x-spcola-rule": {"reach": rule.reach, "scope": rule.scope},
                    **options.pop("extra", {}),
                },
            }
            self._added.append((f"{self.prefix}{path}", endpoint, given | options))
            return endpoint

        return added

    def add_to(self, app: FastAPI) -> None:
        """Add the routes to an application."""
        for path, endpoint, options in self._added:
            app.router.add_api_route(path, endpoint, **options)


def rules_of(app: FastAPI) -> dict[tuple[str, str], Rule]:
    """Return the rule of every route by method and path.

    Raises
    ------
    TypeError
        If a route has none.
    """
    rules: dict[tuple[str, str], Rule] = {}
    for route in app.routes:
        found = [each.dependency for each in getattr(route, "dependencies", ())]
        declared = [rule for rule in found if isinstance(rule, Rule)]
        if not isinstance(route, APIRoute) or len(declared) != 1:
            raise TypeError(f"the route {getattr(route, 'path', route)} declares no rule")
        rules |= {(method, route.path): declared[0] for method in route.methods or ()}
    return rules
