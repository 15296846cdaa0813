"""Where results come from: solutions, runs of stages, and inputs of products."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import PurePosixPath
from typing import Any

from fusion.inspection import solution_difference
from fusion.pipeline.catalog import SHARED_STAGES, read_records
from fusion.pipeline.solutions import lineage, solutions_of
from fusion.products import MANIFEST_FILE
from fusion.runtime import content_digest, json_value
from fusion.workspace import IMPORTED, Workspace
from spcola.errors import WorkspaceError

__all__ = [
    "provenance",
    "run_list",
    "run_record",
    "runs_compared",
    "solution_tree",
    "solutions_compared",
]

# A stage with more inputs from one folder has them as one node.
_MOST_FILES = 24


def solution_tree(workspace: Workspace) -> dict[str, Any]:
    """Return the solutions, each after its parent, and which one is in use.

    Parameters
    ----------
    workspace : Workspace

    Returns
    -------
    dict
        `in_use`; `solutions`: records (`name`, `parent`, `made_by`, `made`, `constants`, `facts`,
        …); `problems` of those whose records are damaged.
    """
    found = solutions_of(workspace)
    return {
        "in_use": Workspace.open(workspace.root).solution,
        "solutions": [record.as_json() for record in found.records],
        "problems": [str(error) for error in found.damaged],
    }


def solutions_compared(workspace: Workspace, first: str, second: str) -> dict[str, Any]:
    """Return how the solution `second` differs from `first`: ``spcola solution diff``.

    Parameters
    ----------
    workspace : Workspace
    first, second : str
        Names of the solutions.

    Raises
    ------
    SpcolaError
        If one is not there, or a file of it cannot be read.
    """
    one, two = (Workspace.open(workspace.root, name) for name in (first, second))
    return solution_difference(one, two).as_json()


def run_list(workspace: Workspace) -> list[dict[str, Any]]:
    """Return the last run of each stage in each solution, the newest first.

    Parameters
    ----------
    workspace : Workspace

    Returns
    -------
    list of dict
        `id` (``SOLUTION:STAGE``), `solution`, `stage`, `finished`, `version`, `key`,
        `settings_digest`, `verdict` (None for stages without), numbers of `inputs` and `outputs`.
    """
    runs = [
        {
            **{key: run[key] for key in _LISTED},
            "verdict": run["summary"].get("verdict"),
            "inputs": len(run["inputs"]),
            "outputs": len(run["outputs"]),
        }
        for run in _runs(workspace).values()
    ]
    return sorted(runs, key=lambda run: (run["finished"], run["id"]), reverse=True)


def run_record(workspace: Workspace, identity: str) -> dict[str, Any]:
    """Return a run with its settings, summary, and digests of inputs and outputs.

    Parameters
    ----------
    workspace : Workspace
    identity : str
        `id` of :func:`run_list`.

    Raises
    ------
    WorkspaceError
        If there is none.
    """
    runs = _runs(workspace)
    if identity not in runs:
        do = f"there are: {', '.join(runs) or 'none'}"
        raise WorkspaceError(f"there is no run {identity!r}", workspace.root, do)
    return runs[identity]


def run_request(workspace: Workspace, identity: str) -> dict[str, Any]:
    """Return the job that reproduces a run: its stage with its settings, in its solution.

    In a workspace with the same inputs and the same version of the program it makes the same files
    to the bit; :func:`runs_compared` shows it.

    Parameters
    ----------
    workspace : Workspace
    identity : str
        `id` of :func:`run_list`.

    Raises
    ------
    WorkspaceError
        If there is none.
    """
    run = run_record(workspace, identity)
    tables = {
        name: run["settings"][type(table).__name__]
        for name, table in workspace.settings()
        if type(table).__name__ in run["settings"]
    }
    parameters = {"stages": [run["stage"]], "solution": run["solution"], "settings": tables}
    return {"kind": "run", "parameters": {**parameters, "force": True}}


def runs_compared(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Return what differs between two runs (:func:`run_record`), also of different workspaces.

    Parameters
    ----------
    first, second : mapping

    Returns
    -------
    dict
        `same`, whether equal results are to be expected (stage and `key` are equal), and for
        `settings`, `results`, `inputs` and `outputs` (digests) what differs: key → both values,
        None where one lacks it.
    """
    return {
        "first": first["id"],
        "second": second["id"],
        "same": (first["stage"], first["key"]) == (second["stage"], second["key"]),
        "settings": _differing(_flat(first["settings"]), _flat(second["settings"])),
        "results": _differing(_flat(first["summary"]), _flat(second["summary"])),
        "inputs": _differing(first["inputs"], second["inputs"]),
        "outputs": _differing(first["outputs"], second["outputs"]),
    }


def provenance(workspace: Workspace, product: str) -> dict[str, Any]:
    """Return what a file was made from, back to the imported files.

    Parameters
    ----------
    workspace : Workspace
    product : str
        Path of the file in the workspace, such as ``release/manifest.json``.

    Returns
    -------
    dict
        `nodes`: files (`id`, `type`, `digest`, `made`: whether a stage made it), groups of many
        files of one folder (`files`), and runs of stages (`id`, `type`, `finished`, `version`,
        `settings_digest`); `edges`: pairs of ids, from what was made to what it was made from;
        `solutions`: the records of the solution and of those that it was made from.

    Raises
    ------
    WorkspaceError
        If no stage made the file.
    """
    runs = {run["stage"]: run for run in _runs(workspace).values() if _is_of(workspace, run)}
    makers = {name: run for run in runs.values() for name in run["outputs"]}
    if product not in makers:
        raise WorkspaceError("was made by no stage that is recorded", workspace.path_of(product))
    graph, made_from = _Graph(), _made_from(workspace, product)
    waiting = [(product, makers[product])]
    while waiting:
        name, run = waiting.pop()
        if name == product:
            graph.file(name, run["outputs"][name], made=True)
            graph.edge(name, run["id"])
        if not graph.add({key: run[key] for key in _NODE} | {"type": "run"}):
            continue
        inputs = run["inputs"]
        if name == product and made_from:
            inputs = {each: digest for each, digest in inputs.items() if each in made_from}
        graph.inputs(run["id"], inputs, makers)
        waiting += [(each, makers[each]) for each in _one_of_each_run(inputs, makers)]
    return {
        "nodes": list(graph.nodes.values()),
        "edges": list(graph.edges),
        "solutions": [record.as_json() for record in lineage(workspace)],
    }


@dataclass
class _Graph:
    """Nodes by their ids, and edges from what was made to what it was made from."""

    nodes: dict[str, dict[str, Any]] = field(default_factory=dict)
    edges: dict[tuple[str, str], None] = field(default_factory=dict)

    def add(self, node: dict[str, Any]) -> bool:
        """Add a node; return whether it is new."""
        new = node["id"] not in self.nodes
        self.nodes.setdefault(node["id"], node)
        return new

    def edge(self, made: str, source: str) -> None:
        """Add an edge, once."""
        self.edges.setdefault((made, source))

    def file(self, name: str, digest: str, *, made: bool) -> None:
        """Add a file."""
        self.add({"id": name, "type": "file", "digest": digest, "made": made})

    def inputs(
        self, run: str, inputs: Mapping[str, str], makers: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Add the inputs of a run: single files, and groups of many of one folder."""
        folders: dict[str, dict[str, str]] = {}
        for name, digest in inputs.items():
            folders.setdefault(str(PurePosixPath(name).parent), {})[name] = digest
        for folder, files in folders.items():
            if len(files) <= _MOST_FILES:
                for name, digest in files.items():
                    self.file(name, digest, made=name in makers)
                    self.edge(run, name)
                    if name in makers:
                        self.edge(name, makers[name]["id"])
                continue
            group = f"{folder}/ ({len(files)} files, {content_digest(files)[:8]})"
            made = {makers[name]["id"] for name in files if name in makers}
            self.add({"id": group, "type": "group", "files": files, "made": bool(made)})
            self.edge(run, group)
            for maker in sorted(made):
                self.edge(group, maker)


_LISTED = ("id", "solution", "stage", "finished", "version", "key", "settings_digest")
_NODE = ("id", "solution", "stage", "finished", "version", "settings_digest")


def _runs(workspace: Workspace) -> dict[str, dict[str, Any]]:
    """Return the records of all sound solutions by `id`; those that they share once."""
    found = {}
    for solution in solutions_of(workspace).records:
        for record in read_records(replace(workspace, solution=solution.name)):
            if solution.name != IMPORTED and record.stage in SHARED_STAGES:
                continue
            identity = f"{solution.name}:{record.stage}"
            found[identity] = {
                **json_value(asdict(record)),
                "inputs": _named(record.inputs),
                "id": identity,
                "solution": solution.name,
                "settings_digest": content_digest(json_value(record.settings)),
            }
    return found


def _named(inputs: Mapping[str, str]) -> dict[str, str]:
    """Return inputs (digest by name) as users know them: those outside by their last part alone.

    Where files of several folders have the same name, part of the digest is added.
    """
    found: dict[str, str] = {}
    for name, digest in inputs.items():
        shown = PurePosixPath(name).name if name.startswith("/") else name
        same = found.get(shown, digest) == digest
        found[shown if same else f"{shown} ({digest[:8]})"] = digest
    return found


def _is_of(workspace: Workspace, run: Mapping[str, Any]) -> bool:
    """Return whether a run made results of the workspace's solution, or of all solutions."""
    return run["solution"] == workspace.solution or run["stage"] in SHARED_STAGES


def _made_from(workspace: Workspace, product: str) -> set[str]:
    """Return from which inputs a released product was made; empty for others."""
    folder, _, file = product.rpartition("/")
    manifest = workspace.find_json(f"{folder}/{MANIFEST_FILE}") if folder == "release" else None
    entries = [] if manifest is None else manifest.get("products") or []
    return {name for one in entries if one.get("file") == file for name in one["made_from"]}


def _one_of_each_run(
    inputs: Mapping[str, str], makers: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """Return one input made by each run: the others have the same run behind them."""
    return list({makers[name]["id"]: name for name in inputs if name in makers}.values())


def _differing(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Return both values of what differs of two mappings."""
    keys = sorted({*first, *second})
    pairs = {key: (first.get(key), second.get(key)) for key in keys}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def _flat(content: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of nested mappings by ``outer.inner``; lists as they are."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        inner = _flat(value, f"{before}{key}.") if isinstance(value, Mapping) else None
        found |= {f"{before}{key}": value} if inner is None else inner
    return found
