"""Whether what stages wrote is still as they left it, by the digests in their records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from fusion.estimation.verdict import Code, Finding, Severity
from fusion.pipeline.catalog.catalog import Catalog
from fusion.pipeline.catalog.records import StageRecord
from fusion.pipeline.stage import Stage

# So many files are named; of the others only the number is.
_NAMED = 3


@dataclass(frozen=True)
class Changed:
    """Files that are not as a stage left them, by their names in the catalogue.

    Attributes
    ----------
    stage : str
    differing, gone, foreign : tuple of str
        With another content than the stage recorded; missing; there, but not in its record.
    unrecorded : tuple of str
        There, and the stage has no record that could tell whether they are as it left them.
    """

    stage: str
    differing: tuple[str, ...] = ()
    gone: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    unrecorded: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.is_contradicted or bool(self.unrecorded)

    @property
    def is_contradicted(self) -> bool:
        """Whether the record of the stage says otherwise."""
        return bool(self.differing or self.gone or self.foreign)

    @property
    def text(self) -> str:
        """What is not as it was, in one clause."""
        parts = []
        if self.differing:
            verb = "has" if len(self.differing) == 1 else "have"
            parts.append(
                f"{_named(self.differing)} {verb} changed since stage {self.stage} wrote it"
            )
        if self.gone:
            verb = "is" if len(self.gone) == 1 else "are"
            parts.append(f"{_named(self.gone)}, which stage {self.stage} wrote, {verb} gone")
        if self.foreign:
            verb = "stands" if len(self.foreign) == 1 else "stand"
            parts.append(f"{_named(self.foreign)} {verb} not in the record of stage {self.stage}")
        if self.unrecorded:
            parts.append(
                f"no record of stage {self.stage} tells whether {_named(self.unrecorded)} "
                f"{'is' if len(self.unrecorded) == 1 else 'are'} as it was left"
            )
        return " and ".join(parts)

    def finding(self, severity: Severity) -> Finding:
        """Return this as a finding about whatever rests on these files."""
        return Finding(Code.CHANGED_INPUT, severity, self.text)


@dataclass(frozen=True)
class Changes:
    """Compares the files of a workspace with the records of its stages.

    Parameters
    ----------
    stages : sequence of Stage
    catalog : Catalog
    """

    stages: Sequence[Stage]
    catalog: Catalog

    def own(self, stage: Stage) -> Changed:
        """Return what of the last results of `stage` is not as it left it."""
        record = self.catalog.record(stage.name)
        return Changed(stage.name) if record is None else self._of_record(record)

    def before(self, stage: Stage, inputs: Collection[str]) -> list[Changed]:
        """Return what is not as the stages left it on whose results `stage` rests.

        Parameters
        ----------
        stage : Stage
        inputs : collection of str
            The files that it reads, by their names in the catalogue.
        """
        owned = dict(self._owners(stage, inputs))
        found = []
        for earlier in self._upstream(stage, {one.name for one in owned.values()}):
            record = self.catalog.record(earlier.name)
            read = [name for name, owner in owned.items() if owner is earlier]
            if record is None:
                found.append(Changed(earlier.name, unrecorded=tuple(read)))
                continue
            foreign = tuple(name for name in read if name not in record.outputs)
            found.append(replace(self._of_record(record), foreign=foreign))
        return [changed for changed in found if changed]

    def used_before(self, stage: Stage, inputs: Mapping[str, str]) -> tuple[str, ...]:
        """Return the inputs that no stage wrote and that changed since `stage` last used them."""
        record = self.catalog.record(stage.name)
        if record is None:
            return ()
        written = {name for earlier in self.stages for name in self._outputs(earlier)}
        return tuple(
            name
            for name, digest in inputs.items()
            if name not in written and record.inputs.get(name, digest) != digest
        )

    def _outputs(self, stage: Stage) -> Iterable[str]:
        record = self.catalog.record(stage.name)
        return () if record is None else record.outputs

    def _of_record(self, record: StageRecord) -> Changed:
        root = self.catalog.workspace.root
        there = {name: root / name for name in record.outputs if (root / name).is_file()}
        digests = self.catalog.digests_of(list(there.values()))
        differing = (
            name
            for name, digest in zip(there, digests, strict=True)
            if digest != record.outputs[name]
        )
        gone = tuple(name for name in record.outputs if name not in there)
        return Changed(record.stage, tuple(differing), gone)

    def _owners(self, stage: Stage, inputs: Iterable[str]) -> Iterator[tuple[str, Stage]]:
        """Yield the inputs that lie where another stage alone writes, and that stage."""
        for name in inputs:
            for other in self.stages:
                if other is not stage and name.partition("/")[0] in other.places:
                    yield name, other

    def _upstream(self, stage: Stage, named: Collection[str]) -> list[Stage]:
        """Return the stages `named` and those that `stage` needs, each with what it needs."""
        wanted, waiting = set[str](), [*stage.needs, *named]
        known = {one.name: one for one in self.stages}
        while waiting:
            name = waiting.pop()
            if name in known and name not in wanted:
                wanted.add(name)
                waiting += known[name].needs
        return [one for one in self.stages if one.name in wanted]


def _named(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are."""
    shown, more = ", ".join(names[:_NAMED]), len(names) - _NAMED
    return shown if more <= 0 else f"{shown} and {more} more"


def changed_since(names: Sequence[str], stage: str) -> str:
    """Return in one clause which inputs changed since `stage` last used them."""
    verb = "has" if len(names) == 1 else "have"
    return f"{_named(names)} {verb} changed since stage {stage} last used it"
