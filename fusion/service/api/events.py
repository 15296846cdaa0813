"""Events as they happen (server-sent events), from where a reader left off."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

from starlette.concurrency import run_in_threadpool

from fusion.runtime import json_value
from fusion.service.jobs import Event, JobQueue

_PAGE = 500


@dataclass
class EventFeed:
    """Looks for new events on behalf of all open streams.

    Parameters
    ----------
    queue : JobQueue
    every_s : float
        How often it looks, s, whatever the number of streams.
    listeners : list of callable
        Each takes every event that happens after the start.
    """

    queue: JobQueue
    every_s: float = 0.25
    listeners: list[Callable[[Event], None]] = field(default_factory=list)
    last: int = 0
    _news: asyncio.Condition = field(default_factory=asyncio.Condition)
    _closed: bool = False
    _caught_up: bool = False

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Look for events meanwhile."""
        task = asyncio.create_task(self._look())
        try:
            yield
        finally:
            await self.close()
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    async def close(self) -> None:
        """End all streams."""
        async with self._news:
            self._closed = True
            self._news.notify_all()

    async def _look(self) -> None:
        while True:
            # A store that cannot be read for a moment is asked again; streams only wait.
            with suppress(Exception):
                fresh = await run_in_threadpool(self.queue.events, self.last, limit=_PAGE)
                for event in fresh if self._caught_up else ():
                    for listener in self.listeners:
                        listener(event)
                self._caught_up = self._caught_up or len(fresh) < _PAGE
                if fresh:
                    async with self._news:
                        self.last = fresh[-1].number
                        self._news.notify_all()
                if len(fresh) == _PAGE:
                    continue
            await asyncio.sleep(self.every_s)

    async def wait(self, after: int, most_s: float) -> bool:
        """Wait until there may be events after a number; return whether the feed goes on."""
        with suppress(TimeoutError):
            async with asyncio.timeout(most_s), self._news:
                await self._news.wait_for(lambda: self._closed or self.last > after)
        return not self._closed


async def stream(
    feed: EventFeed,
    after: int,
    *,
    job: str,
    workspaces: Collection[str] | None,
    heartbeat_s: float,
) -> AsyncIterator[str]:
    """Yield the events after a number as texts of a stream, and a comment if there is none.

    Parameters
    ----------
    feed : EventFeed
    after : int
        Number of the last event that the reader has.
    job : str
        Only events of this job; empty for those of all.
    workspaces : collection of str, optional
        Only events of these.
    heartbeat_s : float
        After this time without an event a comment is sent, so that a broken connection shows.
    """
    yield "retry: 2000\n\n"
    while True:
        # Asked before the question, so that what happens meanwhile is not passed over.
        seen = feed.last
        found = await run_in_threadpool(
            feed.queue.events, after, job=job, workspaces=workspaces, limit=_PAGE
        )
        for event in found:
            yield event_text(event)
        after = found[-1].number if found else after
        if len(found) < _PAGE:
            goes_on = await feed.wait(max(after, seen), heartbeat_s)
            if not goes_on:
                return
            if feed.last <= max(after, seen):
                yield ": still here\n\n"


def event_text(event: Event) -> str:
    """Return an event as the text of a stream."""
    data = json.dumps(json_value(event.as_json()), separators=(",", ":"))
    return f"id: {event.number}\nevent: {event.kind}\ndata: {data}\n\n"
