"""Pages of lists: the same for all that can grow."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Annotated, TypeVar
from urllib.parse import urlencode

from fastapi import Query
from starlette.requests import Request

from fusion.service.api.errors import Refusal, RequestRefusedError

Item = TypeVar("Item")
After = Annotated[str, Query(max_length=300, description="Last one of the page before.")]
Limit = Annotated[int, Query(ge=1, le=1000, description="Items on a page.")]


def page_of(
    request: Request,
    items: Sequence[Item],
    after: str,
    limit: int,
    name: Callable[[Item], str] = str,
) -> tuple[list[Item], dict[str, str]]:
    """Return the items that follow the one called `after`, and the header with the next page.

    Raises
    ------
    RequestRefusedError
        If it is not there any more, and no alphabetical order shows where the page begins.
    """
    names = [name(item) for item in items]
    if not after:
        first = 0
    elif after in names:
        first = names.index(after) + 1
    elif names == sorted(names):
        first = bisect_right(names, after)
    else:
        raise RequestRefusedError(
            Refusal.INVALID,
            f"there is no {after!r}",
            "after",
            "begin with the first page",
        )
    beyond = first + limit
    more = next_link(request, "after", names[beyond - 1]) if beyond < len(names) else {}
    return list(items[first:beyond]), more


def next_link(request: Request, key: str, value: str) -> dict[str, str]:
    """Return the header that names the next page of a list: the same question with one key set."""
    asked = [(name, one) for name, one in request.query_params.multi_items() if name != key]
    return {"Link": f'<{request.url.path}?{urlencode([*asked, (key, value)])}>; rel="next"'}
