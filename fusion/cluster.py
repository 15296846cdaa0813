"""The same work on more than one machine: tasks for a Dask cluster over a shared folder."""

from __future__ import annotations

import platform
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from typing import Any, Generic, TypeVar

import cloudpickle
from distributed import Client
from distributed.client import FutureCancelledError

from fusion.executor import AHEAD
from fusion.interrupt import heed_interrupts
from fusion.threads import one_blas_thread
from spcola.errors import SettingsError

Item = TypeVar("Item")
Result = TypeVar("Result")

WHERE = "--cluster"
# Results are the same to the bit where these are.
_ALIKE = ("spcola", "numpy", "scipy", "numba")
_ANSWER_S = 20
# A task is given up when so many workers died of it, or its function was lost as often.
_TRIES = 3


@dataclass
class _Waiting(Generic[Item]):
    item: Item
    future: Any
    tries: int = 0


class ClusterExecutor:
    """Runs calls on the workers of a Dask scheduler; they see the workspace under its path.

    The function of a step is sent to the workers once, an item and its result with each task. A
    worker that dies changes nothing but the time: its tasks are done by others.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    SettingsError
        If no scheduler answers, it has no worker, or a worker has other versions than this process:
        results would not be the same.
    """

    def __init__(self, address: str) -> None:
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise SettingsError(
                f"no Dask scheduler answers at {address}",
                WHERE,
                "start one: dask scheduler, and on each machine: dask worker ADDRESS",
            ) from error
        try:
            self.workers = self._threads()
            self._check_versions()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Leave the cluster; it goes on without this process."""
        self._client.close()

    def stream(
        self, function: Callable[[Item], Result], items: Iterable[Item], *, ahead: int = AHEAD
    ) -> Iterator[Result]:
        """Yield the results in the order of `items`.

        `items` is read as workers become free, and at most `ahead` results per thread of the
        cluster wait to be taken.
        """
        payload = cloudpickle.dumps(function)
        sent = _Sent(self._client, payload)
        waiting: deque[_Waiting[Item]] = deque()
        try:
            for item in items:
                waiting.append(_Waiting(item, sent.submit(item)))
                if len(waiting) >= ahead * self.workers:
                    yield _taken(waiting, sent)
            while waiting:
                yield _taken(waiting, sent)
        finally:
            self._client.cancel([one.future for one in waiting], force=True)

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """Return the results in the order of `items`."""
        return list(self.stream(function, items))

    def _threads(self) -> int:
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        threads = sum(int(worker["nthreads"]) for worker in workers)
        if threads == 0:
            raise SettingsError(
                "the cluster has no worker", WHERE, "start one on each machine: dask worker ADDRESS"
            )
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


class _Sent:
    """A function that the workers hold."""

    def __init__(self, client: Any, payload: bytes) -> None:
        self._client, self._payload = client, payload
        self._digest = sha256(payload).hexdigest()
        self._held = self._scattered()

    def _scattered(self) -> Any:
        return self._client.scatter(self._payload, broadcast=True, hash=False)

    def submit(self, item: Any) -> Any:
        return self._client.submit(perform, self._held, self._digest, item, pure=False)

    def submit_again(self, item: Any) -> Any:
        """Submit an item after the workers that held the function were lost with it."""
        self._held = self._scattered()
        return self.submit(item)


def _taken(waiting: deque[_Waiting[Item]], sent: _Sent) -> Any:
    """Return the oldest result, unless Ctrl-C came before it."""
    oldest = waiting[0]
    while True:
        try:
            result = oldest.future.result()
            break
        except FutureCancelledError:
            oldest.tries += 1
            if oldest.tries >= _TRIES:
                raise
            oldest.future = sent.submit_again(oldest.item)
    waiting.popleft()
    heed_interrupts()
    return result


# What this worker does now: unpacked once, for it may open files or build what rays are cast at.
_unpacked: dict[str, Callable[[Any], Any]] = {}


def perform(payload: bytes, digest: str, item: Any) -> Any:
    """Apply the function in `payload` to an item; runs on a worker."""
    function = _unpacked.get(digest)
    if function is None:
        _unpacked.clear()
        function = _unpacked.setdefault(digest, cloudpickle.loads(payload))
    # As on threads at home: the tasks are the parallelism, and BLAS must not add its own.
    with one_blas_thread():
        return function(item)


def versions() -> dict[str, str]:
    """Return the versions that results depend on."""
    return {"Python": platform.python_version(), **{name: version(name) for name in _ALIKE}}
