"""How stages stand to the files that they read and wrote, and to files that change."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

from fusion.pipeline.changed_files import Changed

__all__ = ["FileRoles", "Roles", "Standing", "differing", "standings_after"]


@dataclass(frozen=True)
class Standing:
    """How a stage stands to the files that it read and wrote when it last ran.

    Attributes
    ----------
    stage : str
    barred : str
        Why it cannot run; empty if it can.
    repeats : bool
        Whether it ran before with the same version and settings, on files of the same names.
    inputs, outputs : mapping of str to str
        Those that differ from its record, with the recorded digest; inputs only if it `repeats`.
    gone : tuple of str
        Outputs that are gone.
    """

    stage: str
    barred: str = ""
    repeats: bool = False
    inputs: Mapping[str, str] = field(default_factory=dict)
    outputs: Mapping[str, str] = field(default_factory=dict)
    gone: tuple[str, ...] = ()

    @property
    def state(self) -> str:
        """Return "up to date", "due", or "cannot run: …", with the reason."""
        if self.barred:
            return f"cannot run: {self.barred}"
        changed = Changed(self.stage, tuple(sorted(self.outputs)), self.gone)
        if self.repeats and not self.inputs and not changed:
            return "up to date"
        return f"due: {changed.text}" if changed else "due"

    def after(self, name: str, before: str, now: str, roles: Roles) -> Standing:
        """Return how it stands after a file got other content, and the digest `now`.

        Whether it can run, and the names of what it reads, must not depend on the content.
        """
        inputs, outputs = self.inputs, self.outputs
        if self.repeats and self.stage in roles.readers:
            inputs = _with_digest(inputs, name, before, now)
        if self.stage in roles.writers:
            outputs = _with_digest(outputs, name, before, now)
        return replace(self, inputs=inputs, outputs=outputs)

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Rebuild it from :meth:`as_json`."""
        return cls(**{**content, "gone": tuple(content["gone"])})


@dataclass(frozen=True)
class Roles:
    """Names of the stages that read, and that wrote, some files of a workspace."""

    readers: tuple[str, ...] = ()
    writers: tuple[str, ...] = ()


@dataclass(frozen=True)
class FileRoles:
    """Which files of a workspace stages read and wrote, by their names in the catalogue."""

    files: Mapping[Roles, Sequence[str]]

    @classmethod
    def of_stages(
        cls, read: Mapping[str, Iterable[str]], written: Mapping[str, Iterable[str]]
    ) -> Self:
        """Return the roles of all files, from those that each stage read and wrote."""
        readers, writers = _stages_by_file(read), _stages_by_file(written)
        files: dict[Roles, list[str]] = {}
        for name in {**readers, **writers}:
            roles = Roles(tuple(readers.get(name, ())), tuple(writers.get(name, ())))
            files.setdefault(roles, []).append(name)
        return cls(files)

    def of(self, name: str) -> Roles:
        """Return the roles of a file."""
        return next((roles for roles, names in self.files.items() if name in names), Roles())

    def as_json(self) -> list[Any]:
        """Return them in JSON types."""
        return [[one.readers, one.writers, list(names)] for one, names in self.files.items()]

    @classmethod
    def from_json(cls, content: Sequence[Any]) -> Self:
        """Rebuild them from :meth:`as_json`."""
        return cls({Roles(tuple(one), tuple(other)): names for one, other, names in content})


def standings_after(
    standings: Iterable[Standing],
    roles: FileRoles,
    changes: Iterable[tuple[str, str, str]],
    plain: Collection[str] = (),
) -> list[Standing] | None:
    """Return how stages stand to their files after some of these got other content.

    Parameters
    ----------
    standings : iterable of Standing
        Before the changes.
    roles : FileRoles
        Those that wrote a file are stages whose results are only compared by their digests, and
        not looked into, to know the states of stages.
    changes : iterable of (str, str, str)
        Name, digest before, and digest now of each file whose content changed.
    plain : collection of str
        Files that no stage wrote, but that are only compared too.

    Returns
    -------
    list of Standing or None
        None if no stage wrote one of the other files: more than their digests may matter.
    """
    found = list(standings)
    for name, before, now in changes:
        its = roles.of(name)
        if not its.writers and name not in plain:
            return None
        found = [one.after(name, before, now, its) for one in found]
    return found


def differing(recorded: Mapping[str, str], now: Mapping[str, str]) -> dict[str, str]:
    """Return the recorded digests of files that have others now."""
    return {name: digest for name, digest in recorded.items() if now[name] != digest}


def _stages_by_file(found: Mapping[str, Iterable[str]]) -> dict[str, list[str]]:
    stages: dict[str, list[str]] = {}
    for stage, names in found.items():
        for name in names:
            stages.setdefault(name, []).append(stage)
    return stages


def _with_digest(
    differing: Mapping[str, str], name: str, before: str, now: str
) -> Mapping[str, str]:
    """Return the files that differ from their recorded digests, after one of them got another."""
    recorded = differing.get(name, before)
    others = {one: digest for one, digest in differing.items() if one != name}
    return others if now == recorded else {**others, name: recorded}
