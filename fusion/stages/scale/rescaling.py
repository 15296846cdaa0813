"""A scaled copy of the SPC solution of a workspace: ``spcola scale --apply``."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.runtime import Progress, json_text
from fusion.runtime.folders import clear_abandoned_folders, make_folder
from fusion.verdict import Code, Verdict
from fusion.workspace import (
    OWN_FOLDERS,
    SETTINGS_FILE,
    SPC_FOLDERS,
    SPC_LISTS,
    Workspace,
)
from fusion.workspace.settings import Settings, write_settings
from fusion.workspace.settings.inputs import BodySettings
from spcola import atomic
from spcola.control import (
    scaled,
)
from spcola.errors import NotObservableError, WorkspaceError
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

APPLIED_FILE = "applied_scale.json"
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
    """The scaled copy of a solution.

    Attributes
    ----------
    folder : Path
        A workspace with the scaled solution, the same settings and the same scans.
    epsilon, epsilon_sigma : float
        All lengths are 1 + ε times those of the original; sigma of ε.
    written : mapping of str to int
        Number of files scaled, by folder.
    copied : tuple of str
        Files in SPC folders of unknown formats, copied as they are.
    """

    folder: Path
    epsilon: float
    epsilon_sigma: float
    written: Mapping[str, int]
    copied: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the content in JSON types."""
        return {
            "folder": str(self.folder),
            "epsilon": self.epsilon,
            "epsilon_sigma": self.epsilon_sigma,
            "factor": 1.0 + self.epsilon,
            "written": dict(self.written),
            "copied": list(self.copied),
        }

    def lines(self) -> list[str]:
        """Return the lines to print."""
        counts = ", ".join(f"{count} in {name}" for name, count in self.written.items())
        lines = [
            f"applied: all lengths times 1 {self.epsilon:+.4e} (sigma {self.epsilon_sigma:.1e})",
            f"  written to {self.folder}: {counts}",
        ]
        if self.copied:
            lines.append(f"  copied as they are, no known format: {', '.join(self.copied)}")
        return [*lines, f"  next: spcola scale {self.folder}"]


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
    workspace: Workspace, folder: Path, progress: Progress, *, accepted: Iterable[str] = ()
) -> AppliedScale:
    """Write the workspace's SPC solution, multiplied by 1 + ε of ``scale.json``, to `folder`.

    Maplets with their sigmas, landmarks, states, nominal states and shapes are scaled; lists are
    copied, pixels and scans linked. The original is unchanged. The folder is written whole or not
    at all. `accepted` are codes of accepted findings.

    Raises
    ------
    NotObservableError
        If there is no usable ε.
    WorkspaceError
        If `folder` exists, or something cannot be read or written.
    FormatError
        If a file of the solution is damaged.
    """
    where = workspace.scale_path
    epsilon, sigma = usable_epsilon(workspace.read_json(where.name), where, accepted)
    if folder.exists() or folder.is_symlink():
        raise WorkspaceError("exists already", folder, "name a folder that does not exist")
    make_folder(folder.parent)
    clear_abandoned_folders(folder)
    making = folder.with_name(f".{folder.name}.{os.getpid()}")
    try:
        made = _written(workspace, making, 1.0 + epsilon, progress)
        applied = AppliedScale(folder, epsilon, sigma, *made)
        content = {**applied.as_dict(), "from": str(workspace.root.resolve())}
        atomic.write_text(making / APPLIED_FILE, json_text(content))
        making.rename(folder)
    except OSError as error:
        raise atomic.write_error(folder, error) from error
    finally:
        shutil.rmtree(making, ignore_errors=True)
    return applied


def _written(
    workspace: Workspace, making: Path, factor: float, progress: Progress
) -> tuple[dict[str, int], tuple[str, ...]]:
    """Write everything into `making`; return counts of scaled files, and names of copied ones."""
    settings = workspace.settings()
    for name in (*SPC_FOLDERS, *OWN_FOLDERS):
        make_folder(making / name)
    write_settings(making / SETTINGS_FILE, _settings(settings, factor))
    for name in SPC_LISTS:
        if (workspace.root / name).is_file():
            shutil.copyfile(workspace.root / name, making / name)
    for path in (*_files(workspace.root / "IMAGEFILES"), *workspace.scan_paths()):
        _link(path, making / path.parent.name / path.name)
    written: dict[str, int] = {}
    copied: list[str] = []
    for name in ("MAPFILES", "LMKFILES", "SUMFILES", "NOMINALS", "SHAPEFILES"):
        paths = list(_files(workspace.root / name))
        count = 0
        with progress.task(f"scale {name}", len(paths)) as task:
            for path in paths:
                write = _writer(path, settings.body)
                if write is not None:
                    write(path, making / name / path.name, factor)
                    count += 1
                elif path.suffix != ".SIG":
                    shutil.copyfile(path, making / name / path.name)
                    copied.append(f"{name}/{path.name}")
                task.advance()
        if count:
            written[name] = count
    return written, tuple(copied)


def _settings(settings: Settings, factor: float) -> Settings:
    """Return the settings of the copy: scaled mean radius, and OBJ faces numbered from 1."""
    settings = settings.with_table("body", faces_from=1)
    radius = settings.body.mean_radius_m
    return settings.with_table("body", mean_radius_m=factor * radius) if radius else settings


Write = Callable[[Path, Path, float], None]


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
    ("NOMINALS", ".NOM"): _text_writer(read_nominal, scaled, write_nominal),
}


def _files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder, if there is one, in the order of their names."""
    if folder.is_dir():
        yield from sorted(p for p in folder.iterdir() if p.is_file() and p.name[0] != ".")


def _link(source: Path, target: Path) -> None:
    """Link to an unchanged file, or copy it if links cannot be made."""
    try:
        target.symlink_to(source.resolve())
    except OSError:
        shutil.copyfile(source, target)
