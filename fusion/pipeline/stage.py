"""Interface of a stage: declared inputs and settings, and a run that returns its outputs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from fusion.estimation.verdict import Finding
from fusion.pipeline.catalog.records import StageRecord
from fusion.pipeline.changed_files import Changed
from fusion.pipeline.items import ItemStore
from fusion.pipeline.subset import Subset
from fusion.runtime import AHEAD, Executor, Progress
from fusion.runtime.remaining import Timed
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings, Table
from spcola.arrays import FloatArray
from spcola.errors import SettingsError

Item = TypeVar("Item")
Result = TypeVar("Result")
AnyTable = TypeVar("AnyTable", bound=Table)


@dataclass(frozen=True)
class StageResult:
    """Outputs of a stage.

    Parameters
    ----------
    outputs : iterable of Path
        Every file that it wrote (or found finished). Their digests go into the catalogue; outputs
        of the last run that are not among them are removed.
    summary : mapping
        What the command prints, also with ``--json``; JSON types, NaN allowed.
    notes : tuple of str
        Messages about this run only.
    remarks : tuple of Finding
        What programs may want to know about this run only: unlike those in `summary`, they are
        not recorded, as equal inputs give equal results whichever run made them.
    """

    outputs: tuple[Path, ...]
    summary: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    remarks: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class StageContext:
    """Inputs, settings and tools with which a stage runs.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
        All tables; a stage reads its own through :meth:`table`.
    tables : tuple of table classes
        Those that the stage declared.
    executor : Executor
        Where work over items is done.
    progress : Progress
        Where its progress is reported.
    inputs : mapping of str to str
        The digest of each input, by its name in the catalogue (``workspace.relative(path)``).
    key : str
        Digest of inputs, settings and version, written into artefacts.
    scratch : Path
        A folder of this run. It survives an interruption as long as `key` is unchanged, so that
        finished parts can be used again, and is removed when the stage is done.
    items : ItemStore
        Where finished items are kept, and found again by what went into them.
    own : Changed, optional
        Which of its last results changed since.
    subset : Subset
        Which items are made; results of the others stay as they are.
    last : StageRecord, optional
        How it last ran.
    """

    workspace: Workspace
    settings: Settings
    tables: tuple[type[Table], ...]
    executor: Executor
    progress: Progress
    inputs: Mapping[str, str]
    key: str
    scratch: Path
    items: ItemStore
    own: Changed | None = None
    subset: Subset = field(default_factory=Subset)
    last: StageRecord | None = None

    def table(self, kind: type[AnyTable]) -> AnyTable:
        """Return the settings table of class `kind`.

        Raises
        ------
        SettingsError
            If the stage did not declare it, so that a change of it would go unnoticed.
        """
        if kind not in self.tables:
            raise SettingsError(f"the stage does not declare {kind.__name__}", "stage")
        return find_table(self.settings, kind)

    def chosen(
        self, items: Mapping[str, Item], centers: Mapping[str, FloatArray] | None = None
    ) -> dict[str, Item]:
        """Return the items that are to be made (:meth:`fusion.pipeline.Subset.chosen`)."""
        return self.subset.chosen(items, centers) if self.subset else dict(items)

    def stream(
        self,
        title: str,
        function: Callable[[Item], Result],
        items: Iterable[Item],
        *,
        sizes: Sequence[float],
        ahead: int = AHEAD,
    ) -> Iterator[Result]:
        """Yield ``function(item)`` in the order of `items`, on the workers, with progress.

        `sizes` is the work in each item, in any unit: the time that is left follows from it. At
        most `ahead` results per worker wait to be taken.
        """
        with self.progress.items(title, sizes, self.executor.workers) as task:
            for result, spent in self.executor.stream(Timed(function), items, ahead=ahead):
                task.advance_one(spent)
                yield result

    def map(
        self, title: str, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> list[Result]:
        """Return ``function(item)`` of every item, in order, on the workers, with progress."""
        items = list(items)
        return list(self.stream(title, function, items, sizes=[1.0] * len(items)))

    def write_json(self, name: str, content: Mapping[str, Any]) -> Path:
        """Write a JSON artefact of the stage, with `key` in it."""
        return self.workspace.write_json(name, {**content, "made_by": self.key})


class Stage(ABC):
    """One step of the processing.

    A module of ``fusion.stages`` defines one as ``STAGE``. The pipeline hashes inputs, the
    declared tables and the version: if the hash and the outputs are those of the last run, the
    stage is up to date and is skipped.

    Attributes
    ----------
    name : str
        Name of the stage and of its command.
    version : int
        Increased whenever the same inputs and settings would give other results.
    needs : tuple of str
        Names of the stages whose results it uses, so that they must be accepted.
    places : tuple of str
        Folders and files of the workspace that only this stage writes.
    tables : tuple of table classes
        Settings tables that the result depends on.
    """

    name: str
    version: int
    needs: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    tables: tuple[type[Table], ...] = ()

    def compares_lidar(self, settings: Settings) -> bool:
        """Return whether it takes the lidar and the maplets as independent of each other."""
        del settings
        return False

    @abstractmethod
    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why the stage cannot run (one clause with what to do), or ``""``."""

    @abstractmethod
    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return every file that the result depends on."""

    @abstractmethod
    def run(self, context: StageContext) -> StageResult:
        """Do the work; write through :mod:`spcola.atomic` only."""


def find_table(settings: Settings, kind: type[AnyTable]) -> AnyTable:
    """Return the table of class `kind`.

    Raises
    ------
    SettingsError
        If the settings have none.
    """
    for name in Settings.model_fields:
        table = getattr(settings, name)
        if isinstance(table, kind):
            return table
    raise SettingsError(f"there is no table {kind.__name__}", "settings")
