"""Calls as steps: written once, done by a session that blocks or by one that awaits.

A call is a generator. It yields what has to be done outside of it (a request is sent, time passes,
something is computed), gets the outcome, and returns its result. It knows neither threads nor an
event loop.
"""

from __future__ import annotations

import inspect
from collections.abc import (
    AsyncIterator,
    Awaitable,
    Callable,
    Generator,
    Iterator,
    Mapping,
)
from dataclasses import dataclass, field
from functools import update_wrapper
from typing import Any, Concatenate, Generic, ParamSpec, Protocol, TypeVar, overload

Given = ParamSpec("Given")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Request:
    """A request to a server; `path` is that below its address."""

    method: str
    path: str
    query: Mapping[str, Any] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    json: Mapping[str, Any] | None = None
    body: bytes | None = None


@dataclass(frozen=True)
class Answer:
    """What a server answered; names of headers are in small letters."""

    status: int
    headers: Mapping[str, str]
    body: bytes = b""


class LostConnectionError(Exception):
    """A request got no answer; `sent` is False if it certainly did not reach the server."""

    def __init__(self, reason: str, *, sent: bool) -> None:
        self.sent = sent
        super().__init__(reason)


@dataclass(frozen=True)
class Send:
    """A request is sent; gives its `Answer`, or raises `LostConnectionError`."""

    request: Request


@dataclass(frozen=True)
class Pause:
    """Time passes, s."""

    seconds: float


@dataclass(frozen=True)
class Compute:
    """A function is called, in a thread of its own where others must not wait; gives its result."""

    function: Callable[[], Any]


@dataclass(frozen=True)
class Open:
    """A request is sent whose answer is a stream; gives its head, and closes the stream before."""

    request: Request


@dataclass(frozen=True)
class NextLine:
    """The next line of the open stream arrives; None at its end."""


@dataclass(frozen=True)
class Emit(Generic[Result]):
    """The caller gets a value, and may never ask for another."""

    value: Result


Effect = Send | Pause | Compute | Open | NextLine
Steps = Generator[Effect, Any, Result]
Emitting = Generator[Effect | Emit[Result], Any, None]


class Doing(Protocol):
    """What a blocking session does effects with."""

    def perform(self, effect: Effect) -> Any:
        """Do an effect and return its outcome."""
        ...

    def close(self) -> None:
        """Close the stream that is open."""
        ...


class DoingAsync(Protocol):
    """What an awaiting session does effects with."""

    async def perform(self, effect: Effect) -> Any:
        """Do an effect and return its outcome."""
        ...

    async def close(self) -> None:
        """Close the stream that is open."""
        ...


class Blocking:
    """Base of sessions whose calls block."""

    doing: Callable[[], Doing]


class Awaiting:
    """Base of sessions whose calls are awaited."""

    doing: Callable[[], DoingAsync]


def _done(steps: Emitting[Result], doing: Doing) -> Iterator[Result]:
    """Do the effects of a call, and yield what it emits."""
    go_on: Callable[[Any], Effect | Emit[Result]] = steps.send
    given: Any = None
    try:
        while True:
            try:
                effect = go_on(given)
            except StopIteration:
                return
            go_on, given = steps.send, None
            if isinstance(effect, Emit):
                yield effect.value
                continue
            try:
                given = doing.perform(effect)
            except Exception as error:
                go_on, given = steps.throw, error
    finally:
        steps.close()
        doing.close()


async def _done_async(steps: Emitting[Result], doing: DoingAsync) -> AsyncIterator[Result]:
    """Do the effects of a call, and yield what it emits."""
    go_on: Callable[[Any], Effect | Emit[Result]] = steps.send
    given: Any = None
    try:
        while True:
            try:
                effect = go_on(given)
            except StopIteration:
                return
            go_on, given = steps.send, None
            if isinstance(effect, Emit):
                yield effect.value
                continue
            try:
                given = await doing.perform(effect)
            except Exception as error:
                go_on, given = steps.throw, error
    finally:
        steps.close()
        await doing.close()


def _emitting(steps: Steps[Result]) -> Emitting[Result]:
    """Return steps that emit their result."""
    yield Emit((yield from steps))


def run(steps: Steps[Result], doing: Doing) -> Result:
    """Do all effects of a call, and return its result."""
    (result,) = _done(_emitting(steps), doing)
    return result


async def run_async(steps: Steps[Result], doing: DoingAsync) -> Result:
    """Do all effects of a call, and return its result."""
    (result,) = [one async for one in _done_async(_emitting(steps), doing)]
    return result


class _Described:
    """A method whose documentation and arguments are those of its steps."""

    def __init__(self, steps: Callable[..., Any]) -> None:
        self._steps = steps
        signature = inspect.signature(steps)
        # Of `Steps[Result]` the caller gets the result.
        _, _, result = str(signature.return_annotation).removesuffix("]").partition("[")
        self._signature = signature.replace(return_annotation=result)
        steps.__signature__ = self._signature  # type: ignore[attr-defined]
        steps.__annotations__["return"] = result

    def _bound(self, session: Any, does: Callable[..., Any]) -> Callable[..., Any]:
        """Return a method of a session that `does` the steps."""
        made = self._steps

        def called(*args: Any, **kwargs: Any) -> Any:
            return does(made(session, *args, **kwargs), session.doing())

        update_wrapper(called, made)
        _, *others = self._signature.parameters.values()
        called.__signature__ = self._signature.replace(parameters=others)  # type: ignore[attr-defined]
        return called


class call(_Described, Generic[Given, Result]):  # noqa: N801  a decorator
    """Makes a generator of steps a method: of a session that blocks, or that is awaited."""

    def __init__(self, steps: Callable[Concatenate[Any, Given], Steps[Result]]) -> None:
        super().__init__(steps)

    @overload
    def __get__(self, session: Blocking, kind: Any = None) -> Callable[Given, Result]: ...
    @overload
    def __get__(
        self, session: Awaiting, kind: Any = None
    ) -> Callable[Given, Awaitable[Result]]: ...
    @overload
    def __get__(self, session: None, kind: Any = None) -> Callable[..., Steps[Result]]: ...
    def __get__(self, session: Blocking | Awaiting | None, kind: Any = None) -> Any:
        if session is None:
            return self._steps
        return self._bound(session, run if isinstance(session, Blocking) else run_async)


class stream(_Described, Generic[Given, Result]):  # noqa: N801  a decorator
    """Makes a generator of steps that emits values a method that iterates over them."""

    def __init__(self, steps: Callable[Concatenate[Any, Given], Emitting[Result]]) -> None:
        super().__init__(steps)

    @overload
    def __get__(self, session: Blocking, kind: Any = None) -> Callable[Given, Iterator[Result]]: ...
    @overload
    def __get__(
        self, session: Awaiting, kind: Any = None
    ) -> Callable[Given, AsyncIterator[Result]]: ...
    @overload
    def __get__(self, session: None, kind: Any = None) -> Callable[..., Emitting[Result]]: ...
    def __get__(self, session: Blocking | Awaiting | None, kind: Any = None) -> Any:
        if session is None:
            return self._steps
        return self._bound(session, _done if isinstance(session, Blocking) else _done_async)
