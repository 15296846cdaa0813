"""Settings, folder, body and executor that all parts of making a mission share."""

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
    """A mission that is being made.

    Attributes
    ----------
    settings : MissionSettings
    site : Site
        Its folder.
    body : TruthBody
    executor, progress
        Where work is done, and where its progress is reported.
    """

    settings: MissionSettings
    site: Site
    body: TruthBody
    executor: Executor
    progress: Progress

    def random(self, purpose: str) -> np.random.Generator:
        """Return a random generator for one item, which no other item uses."""
        return stream(self.settings.seed, purpose)

    def done(
        self, title: str, make: Callable[[Item], Result], items: Iterable[Item], count: int
    ) -> Iterator[Result]:
        """Yield the results of `make` for the items in their order, with progress.

        All workers take part: `make` must not depend on other items.
        """
        with self.progress.task(title, count) as task:
            for result in self.executor.stream(make, items):
                yield result
                task.advance()


def missing(path: Path) -> bool:
    """Return whether a file still has to be made; existing files are complete."""
    return not path.exists()
