"""A solution that is scaled: ``spcola scale --apply``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from fusion.estimation.verdict import Code, Verdict
from fusion.pipeline.catalog import file_digest, read_record
from fusion.pipeline.solutions import (
    MadeBy,
    making_solution,
    new_name,
    solution_files,
    solutions_of,
)
from fusion.runtime import Progress, json_value
from fusion.workspace import Workspace
from fusion.workspace.settings.inputs import BodySettings
from spcola.control import (
    scaled,
)
from spcola.errors import NotObservableError
from spcola.formats.maplets import read_map, read_sigma, sigma_path, write_maplet
from spcola.formats.shapes import (
    read_icq,
    read_obj_mesh,
    recognise_shape,
    write_icq,
    write_obj_mesh,
)
from spcola.formats.shapes.ply import read_ply_mesh, write_ply_mesh
from spcola.formats.solution import (
    read_landmark,
    read_nominal,
    read_summary,
    write_landmark,
    write_nominal,
    write_summary,
)
from spcola.formats.solution.line_scan import LINE_SCAN_SUFFIX, read_line_scan, write_line_scan

# Decimals of a written shape, so that scaling it again loses nothing.
_ICQ_DIGITS = 9
# Findings that are only notes on the estimate but forbid to apply it to a whole solution.
_UNUSABLE = frozenset(
    {
        Code.EPSILON_NOT_DETERMINED,
        Code.EPSILON_NOT_SEPARABLE,
        Code.EPSILON_NOT_SIGNIFICANT,
        Code.SCALE_NOT_CONVERGED,
    }
)


@dataclass(frozen=True)
class AppliedScale:
    """A new solution, scaled.

    Attributes
    ----------
    solution, parent : str
    folder : Path
    epsilon, epsilon_sigma : float
        All lengths are 1 + ε times those of the parent; sigma of ε.
    written : mapping of str to int
        Number of files scaled, by folder.
    """

    solution: str
    parent: str
    folder: Path
    epsilon: float
    epsilon_sigma: float
    written: Mapping[str, int]

    def as_dict(self) -> dict[str, Any]:
        """Return the content in JSON types."""
        return {**json_value(asdict(self)), "factor": 1.0 + self.epsilon}

    def lines(self) -> list[str]:
        """Return the lines to print."""
        counts = ", ".join(f"{count} in {name}" for name, count in self.written.items())
        root = self.folder.parent.parent
        return [
            f"applied: all lengths times 1 {self.epsilon:+.4e} (sigma {self.epsilon_sigma:.1e})",
            f"  solution {self.solution}, from {self.parent}: {counts}",
            f"  next: spcola scale {root} --solution {self.solution}",
            f"  or use it from now on: spcola solution use {root} {self.solution}",
        ]


def usable_epsilon(
    content: Mapping[str, Any], where: Path, accepted: Iterable[str] = ()
) -> tuple[float, float]:
    """Return ε and its sigma out of ``scale.json``; `where` is named in errors.

    Parameters
    ----------
    content : mapping
        Of ``scale.json``, with its verdict.
    where : Path
    accepted : iterable of str
        Codes of accepted findings.

    Raises
    ------
    NotObservableError
        If there is no ε, its verdict forbids to use it, or it is not determined, not separable from
        another parameter, or below three sigmas, and that is not accepted.
    """
    named = frozenset(accepted)
    epsilon, sigma = content.get("epsilon"), content.get("epsilon_sigma")
    verdict = Verdict.from_json(content)
    do = "look at its findings; add scans or images, and run: spcola scale"
    obstacle = verdict.obstacle(named)
    if "verdict" not in content:
        obstacle, do = "it has no verdict, an older version wrote it", "run: spcola scale"
    elif not obstacle and (epsilon is None or sigma is None):
        obstacle = str(content.get("reason", "nothing is observed"))
    elif not obstacle:
        found = [one for one in verdict.findings if one.code in _UNUSABLE - named]
        obstacle = "; ".join(f"{one.text} [{one.code}]" for one in found)
        codes = sorted({one.code for one in found})
        do = f"add scans or images; or apply it with {' '.join(f'--accept {c}' for c in codes)}"
    if obstacle:
        raise NotObservableError(
            f"there is no epsilon to apply: {obstacle}", ("epsilon",), where=where, do=do
        )
    return float(content["epsilon"]), float(content["epsilon_sigma"])


def apply_scale(
    workspace: Workspace,
    name: str,
    progress: Progress,
    *,
    accepted: Iterable[str] = (),
    job: str = "",
) -> AppliedScale:
    """Make a solution whose lengths are 1 + ε of ``scale.json`` times those of the workspace's.

    Maplets with their sigmas, landmarks, states, nominal states and shapes are scaled; files of
    other formats are linked. The solution is made whole or not at all.

    Parameters
    ----------
    workspace : Workspace
        Its solution is scaled, and unchanged.
    name : str
        Of the new solution; empty: ``scaled-1``, ``scaled-2``, …
    progress : Progress
    accepted : iterable of str
        Codes of accepted findings.
    job : str, optional
        What asks for it, as the solution's record has it: the same one again gets the solution that
        it made before.

    Raises
    ------
    NotObservableError
        If there is no usable ε.
    WorkspaceError
        If there is a solution of that name, or something cannot be read or written.
    FormatError
        If a file of the solution is damaged.
    """
    scaled_files = _scaled_files(workspace)
    if (made := solutions_of(workspace).of_job(job)) is not None:
        return _applied(made.name, workspace, made.facts, scaled_files)
    where = workspace.scale_path
    content = workspace.read_json(where.name)
    epsilon, sigma = usable_epsilon(content, where, accepted)
    factor, chosen = 1.0 + epsilon, name or new_name(workspace, "", "scaled")
    settings = workspace.settings()
    # OBJ are written with faces numbered from 1.
    body: dict[str, Any] = {"faces_from": 1}
    if settings.body.mean_radius_m:
        body["mean_radius_m"] = factor * settings.body.mean_radius_m
    facts: dict[str, Any] = {
        "epsilon": epsilon, "epsilon_sigma": sigma, "accepted": sorted(set(accepted)),
        **({"job": job} if job else {}),
    }  # fmt: skip
    record = read_record(workspace, "scale")
    made_by = MadeBy(
        "spcola scale --apply", {"body": body}, facts, {where.name: file_digest(where)},
        {} if record is None else record.settings,
    )  # fmt: skip
    with making_solution(workspace, chosen, made_by) as folder:
        for part, files in scaled_files.items():
            with progress.task(f"scale {part}", len(files)) as task:
                for path, write in files:
                    write(path, folder / part / path.name, factor)
                    task.advance()
    return _applied(chosen, workspace, facts, scaled_files)


def _applied(
    name: str, workspace: Workspace, facts: Mapping[str, Any], scaled_files: _ScaledFiles
) -> AppliedScale:
    """Return what was made from the solution of `workspace`."""
    made = replace(workspace, solution=name).home
    written = {folder: len(files) for folder, files in scaled_files.items()}
    epsilon, sigma = facts["epsilon"], facts["epsilon_sigma"]
    return AppliedScale(name, workspace.solution, made, epsilon, sigma, written)


def _scaled_files(workspace: Workspace) -> _ScaledFiles:
    """Return all files with lengths, by folder, each with the function that scales it."""
    body = workspace.settings().body
    found = {
        name: [(path, write) for path in paths if (write := _writer(path, body)) is not None]
        for name, paths in solution_files(workspace).items()
    }
    return {name: files for name, files in found.items() if files}


Write = Callable[[Path, Path, float], None]
_ScaledFiles = Mapping[str, list[tuple[Path, Write]]]


def _writer(path: Path, body: BodySettings) -> Write | None:
    """Return the function that scales a file; None for formats without lengths."""
    if path.parent.name == "SHAPEFILES":
        return lambda source, target, factor: _scale_shape(source, target, factor, body)
    return _WRITERS.get((path.parent.name, path.suffix))


def _scale_maplet(source: Path, target: Path, factor: float) -> None:
    file, companion = read_map(source), sigma_path(source)
    maplet = file.maplet
    if companion.exists():
        maplet = maplet.with_layers(sigma=read_sigma(companion, maplet.grid.half_size))
    write_maplet(
        target,
        scaled(maplet, factor),
        header=file.header,
        sigma_companion=companion.exists(),
    )


def _scale_line_scan(source: Path, target: Path, factor: float) -> None:
    write_line_scan(target, scaled(read_line_scan(source), factor))


def _text_writer(
    read: Callable[[Path], Any], scaled: Callable[[Any, float], Any], write: Callable[..., None]
) -> Write:
    """Return the function that scales a text file and keeps the form of its lines."""
    return lambda source, target, factor: write(target, scaled(read(source), factor), like=source)


def _scale_shape(source: Path, target: Path, factor: float, body: BodySettings) -> None:
    kind, unit = recognise_shape(source), body.shape_unit
    if kind == "icq":
        write_icq(target, scaled(read_icq(source), factor), digits=_ICQ_DIGITS)
    elif kind == "obj":
        shape = read_obj_mesh(source, unit=unit, faces_from=body.faces_from)
        write_obj_mesh(target, scaled(shape, factor), unit=unit)
    else:
        write_ply_mesh(target, scaled(read_ply_mesh(source, unit=unit), factor), unit=unit)


_WRITERS: dict[tuple[str, str], Write] = {
    ("MAPFILES", ".MAP"): _scale_maplet,
    ("LMKFILES", ".LMK"): _text_writer(read_landmark, scaled, write_landmark),
    ("SUMFILES", ".SUM"): _text_writer(read_summary, scaled, write_summary),
    ("SUMFILES", LINE_SCAN_SUFFIX): _scale_line_scan,
    ("NOMINALS", ".NOM"): _text_writer(read_nominal, scaled, write_nominal),
}
