"""Whether the files that stages wrote are unchanged, by the digests in their records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from fusion.pipeline.catalog.catalog import Catalog
from fusion.pipeline.catalog.records import StageRecord
from fusion.pipeline.changed_files import Changed
from fusion.pipeline.stage import Stage


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
        """Return which of the last results of `stage` changed since it ran."""
        record = self.catalog.record(stage.name)
        return Changed(stage.name) if record is None else self._of_record(record)

    def before(self, stage: Stage, inputs: Collection[str]) -> list[Changed]:
        """Return which results changed of the stages on which `stage` depends.

        Parameters
        ----------
        stage : Stage
        inputs : collection of str
            Names in the catalogue of the files that it reads.
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
        found = self.catalog.recorded(record)
        gone = tuple(name for name, digest in found.items() if digest is None)
        differing = (
            name for name, digest in found.items() if digest not in (None, record.outputs[name])
        )
        return Changed(record.stage, tuple(differing), gone)

    def _owners(self, stage: Stage, inputs: Iterable[str]) -> Iterator[tuple[str, Stage]]:
        """Yield the inputs in places where only another stage writes, and that stage."""
        for name in inputs:
            for other in self.stages:
                if other is not stage and name.partition("/")[0] in other.places:
                    yield name, other

    def _upstream(self, stage: Stage, named: Collection[str]) -> list[Stage]:
        """Return the stages `named`, those that `stage` needs, and what these need."""
        wanted, waiting = set[str](), [*stage.needs, *named]
        known = {one.name: one for one in self.stages}
        while waiting:
            name = waiting.pop()
            if name in known and name not in wanted:
                wanted.add(name)
                waiting += known[name].needs
        return [one for one in self.stages if one.name in wanted]
