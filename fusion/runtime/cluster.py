"""Executor on several machines: tasks for a Dask cluster over a shared folder."""

from __future__ import annotations

import asyncio
import math
import platform
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Generic, NamedTuple, TypeVar

from distributed import Client, get_worker
from distributed.client import ClosedClientError
from distributed.comm import CommClosedError
from distributed.core import rpc
from distributed.scheduler import KilledWorker
from distributed.security import Security

from fusion.runtime.children import ItemRun, Payload, PoisonousItemError, item_name, perform
from fusion.runtime.executor import AHEAD, ClusterError
from fusion.runtime.processes.interrupt import check_interrupts
from spcola.errors import SettingsError

Item = TypeVar("Item")
Result = TypeVar("Result")

WHERE = "--cluster"
# Where these versions are the same, results are bit-identical.
_ALIKE = ("spcola", "numpy", "scipy", "numba")
_ANSWER_S = 20
# Interval of checks that the cluster is still there while waiting for a result.
_LOOK_S = 5
_START_WORKERS = "start one on each machine: dask worker ADDRESS"
_START = "start one: dask scheduler, and on each machine: dask worker ADDRESS"
# A task is given up after so many workers died of it, or its function was lost as often.
_TRIES = 3


@dataclass
class _Waiting(Generic[Item]):
    item: Item
    future: Any
    tries: int = 0

    def losses(self) -> tuple[str, ...]:
        """Return how each of its tries ended that gave nothing."""
        return ("its worker was lost",) * self.tries


class ClusterExecutor:
    """Runs calls on the workers of a Dask scheduler; all reach the workspace under the same path.

    The function of a step is sent to the workers once, an item and its result with each task. If
    a worker dies, others do its tasks; results do not change.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as ``tcp://10.0.0.1:8786``.
    seen : callable, optional
        Takes what became of each item, when its result is taken.

    Raises
    ------
    SettingsError
        If no scheduler answers, it has no worker, or a worker has other versions than this process:
        results would not be the same.
    """

    def __init__(self, address: str, *, seen: Callable[[ItemRun], None] = lambda _: None) -> None:
        self._address, self._seen = address, seen
        _check_scheduler(address)
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise _no_scheduler(address) from error
        try:
            self.workers = self._threads()
            self._check_versions()
        except OSError as error:
            self.close()
            raise _no_scheduler(address) from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Leave the cluster, which continues without this process."""
        self._client.close(timeout=1)

    def stream(
        self, function: Callable[[Item], Result], items: Iterable[Item], *, ahead: int = AHEAD
    ) -> Iterator[Result]:
        """Yield the results in the order of `items`.

        `items` is read as workers become free, and at most `ahead` results per thread of the
        cluster wait to be taken.

        Raises
        ------
        ClusterError
            If the scheduler is gone, or all workers are and none comes back within 20 s.
        PoisonousItemError
            If workers died of an item as often as it was tried; it names the item.
        """
        payload = Payload.of(function)
        waiting: deque[_Waiting[Item]] = deque()
        try:
            with self._loss_reported():
                sent = _Sent(self._client, payload)
            for item in items:
                with self._loss_reported():
                    waiting.append(_Waiting(item, sent.submit(item)))
                if len(waiting) >= ahead * self.workers:
                    yield self._taken(waiting, sent)
            while waiting:
                yield self._taken(waiting, sent)
        finally:
            # A lost cluster has no tasks to cancel.
            if self._client.status == "running":
                self._client.cancel([one.future for one in waiting], force=True)

    def _taken(self, waiting: deque[_Waiting[Item]], sent: _Sent) -> Any:
        """Return the oldest result, unless Ctrl-C came before it."""
        oldest = waiting[0]
        name = item_name(oldest.item)
        try:
            outcome = self._awaited(oldest, sent)
        except Exception as error:
            run = ItemRun(name, math.nan, oldest.losses(), type(error).__name__)
            self._seen(run)
            raise
        seconds, worker, ended = outcome.seconds, outcome.worker, outcome.ended
        self._seen(ItemRun(name, seconds, oldest.losses(), worker=worker, ended=ended))
        waiting.popleft()
        check_interrupts()
        return outcome.result

    def _awaited(self, oldest: _Waiting[Item], sent: _Sent) -> _Outcome:
        """Wait for an item; one whose workers were lost is submitted again."""
        while True:
            try:
                with self._loss_reported():
                    self._wait(oldest.future)
                outcome: _Outcome = oldest.future.result()
                return outcome
            except KilledWorker as error:
                raise _given_up(oldest.item) from error
            except CommClosedError as error:
                raise self._lost() from error
            except CancelledError as error:
                self._check_alive()
                oldest.tries += 1
                if oldest.tries >= _TRIES:
                    raise _given_up(oldest.item) from error
                with self._loss_reported():
                    oldest.future = sent.submit_again(oldest.item)

    def _wait(self, future: Any) -> None:
        """Wait for a result or an error, and check that the cluster is still there."""
        alone = None
        while not future.done():
            try:
                future.exception(timeout=_LOOK_S)
            except TimeoutError:
                alone = None if self._check_alive() else alone or time.monotonic()
            check_interrupts()
            if alone is not None and time.monotonic() - alone > _ANSWER_S:
                raise self._deserted()

    def _check_alive(self) -> int:
        """Return how many workers there are.

        Raises
        ------
        ClusterError
            If the scheduler is gone.
        """
        try:
            found = _asked(self._address)
        except (OSError, ValueError) as error:
            raise self._lost() from error
        return len(found.get("workers", {}))

    @contextmanager
    def _loss_reported(self) -> Iterator[None]:
        """Turn whatever fails first when the cluster is lost into one error of one line."""
        try:
            yield
        except (OSError, ClosedClientError) as error:
            if not self._check_alive():
                raise self._deserted() from error
            raise ClusterError(
                f"the cluster failed ({type(error).__name__}: {error})",
                self._address,
                "give the command again: what is finished is kept",
            ) from error

    def _deserted(self) -> ClusterError:
        return ClusterError(
            "the cluster has lost all its workers",
            self._address,
            "start some (dask worker ADDRESS) and give the command again: what is finished is kept",
        )

    def _lost(self) -> ClusterError:
        return ClusterError(
            "the Dask scheduler does not answer any more",
            self._address,
            "start it and its workers and give the command again: what is finished is kept",
        )

    def _threads(self) -> int:
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        threads = sum(int(worker["nthreads"]) for worker in workers)
        if threads == 0:
            raise NoClusterError("the cluster has no worker", WHERE, _START_WORKERS)
        return threads

    def _check_versions(self) -> None:
        here = versions()
        for worker, there in self._client.run(versions).items():
            other = [f"{name} {there[name]}" for name in here if there[name] != here[name]]
            if other:
                mine = ", ".join(
                    f"{name} {here[name]}" for name in here if there[name] != here[name]
                )
                raise SettingsError(
                    f"worker {worker} has {', '.join(other)}, not {mine}",
                    WHERE,
                    "install the same versions: results would not be the same",
                )


class _Outcome(NamedTuple):
    """The result of an item, and how a worker came to it."""

    result: Any
    seconds: float
    worker: str
    ended: float


def _timed(content: bytes, digest: str, item: Any) -> _Outcome:
    """Do an item on a worker; its clock is that of the other spans of its machine."""
    begun = time.monotonic()
    result = perform(content, digest, item)
    seconds = time.monotonic() - begun
    return _Outcome(result, seconds, get_worker().address, time.time())


class _Sent:
    """A function that was sent to the workers."""

    def __init__(self, client: Any, payload: Payload) -> None:
        self._client, self._payload = client, payload
        self._function = self._scattered()

    def _scattered(self) -> Any:
        return self._client.scatter(
            self._payload.content, broadcast=True, hash=False, timeout=_ANSWER_S
        )

    def submit(self, item: Any) -> Any:
        return self._client.submit(_timed, self._function, self._payload.digest, item, pure=False)

    def submit_again(self, item: Any) -> Any:
        """Submit an item again after the workers that had the function were lost."""
        self._function = self._scattered()
        return self.submit(item)


def _asked(address: str) -> dict[str, Any]:
    """Return the identity that the server at `address` reports.

    Raises
    ------
    OSError, ValueError
        If nothing answers in Dask's protocol within the time, or the address cannot be parsed.
    """

    async def identity() -> dict[str, Any]:
        # With the certificates of Dask's own configuration, as the client has them.
        secured = Security().get_connection_args("client")
        async with rpc(address, timeout=_ANSWER_S, connection_args=secured) as server:
            found: dict[str, Any] = await server.identity()
            return found

    try:
        return asyncio.run(asyncio.wait_for(identity(), _ANSWER_S))
    except (TypeError, MemoryError) as error:
        # The answer of another kind of server is misread as lengths of messages.
        raise OSError("no answer in Dask's protocol") from error


def _check_scheduler(address: str) -> None:
    """Refuse an address without a scheduler at once: a client would wait for minutes."""
    try:
        found = _asked(address)
    except (OSError, ValueError) as error:
        raise _no_scheduler(address) from error
    if found.get("type") != "Scheduler":
        raise SettingsError(
            f"{address} is the address of a {str(found.get('type', 'server')).lower()}, not of the "
            "Dask scheduler",
            WHERE,
            "the scheduler prints its own when it starts",
        )


class NoClusterError(ClusterError, SettingsError):
    """No scheduler answers at the address, or it has no worker; both may be on their way."""


def _no_scheduler(address: str) -> NoClusterError:
    do = _START
    if address.startswith("tls:"):
        do = f"{_START}; check the certificates of distributed.comm.tls in Dask's configuration"
    return NoClusterError(f"no Dask scheduler answers at {address}", WHERE, do)


def _given_up(item: Any) -> PoisonousItemError:
    return PoisonousItemError(
        item_name(item), _TRIES, "workers died", "give them more memory, or fewer threads each"
    )


def versions() -> dict[str, str]:
    """Return the versions that results depend on."""
    return {"Python": platform.python_version(), **{name: version(name) for name in _ALIKE}}
