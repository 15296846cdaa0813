"""What every part of the generation of a mission works with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from fusion.runtime import Executor, Progress
from fusion.truth.generation import Site
from fusion.truth.presets import MissionSettings
from spcola.truth.body import TruthBody, stream

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Work:
    """A mission in the making.

    Attributes
    ----------
    settings : MissionSettings
    site : Site
        Where its files go.
    body : TruthBody
    executor, progress
        Where work is done and told.
    """

    settings: MissionSettings
    site: Site
    body: TruthBody
    executor: Executor
    progress: Progress

    def random(self, purpose: str) -> np.random.Generator:
        """Return the random numbers of one item: no other item draws from them."""
        return stream(self.settings.seed, purpose)

    def done(
        self, title: str, make: Callable[[Item], Result], items: Iterable[Item], count: int
    ) -> Iterator[Result]:
        """Yield what `make` returns for each of the items, in their order, and tell how far it is.

        The items are made on all workers: `make` may not depend on what was made before.
        """
        with self.progress.task(title, count) as task:
            for result in self.executor.stream(make, items):
                yield result
                task.advance()


def missing(path: Path) -> bool:
    """Return whether a file still has to be made: what is there is whole."""
    return not path.exists()
