"""A workspace: the folder in which an SPC solution and lidar scans meet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fusion.fusing.maplets import FusedMaplet, read_fused
from fusion.runtime import json_text
from fusion.runtime.folders import make_folder
from fusion.workspace.json_file import read_object
from fusion.workspace.listing import (
    entry_names,
    is_there,
    listed_names,
    visible_files,
    visible_names,
)
from fusion.workspace.settings.settings import Settings, load_settings, write_settings
from fusion.workspace.shape_file import check_unit, shape_file
from fusion.workspace.solution_records.record import (
    IMPORTED,
    SOLUTION_FILE,
    SOLUTION_FOLDER,
    name_in_use,
    read_solution,
    solution_folder,
)
from lidar.adjustment import ScanAdjustment
from lidar.formats.mapolas import ADJUSTMENT_HDF5, read_adjustment, read_mapola
from lidar.gridding import Mapola
from spcola import atomic
from spcola.camera import SpcImage
from spcola.camera.linescan import LineScanImage
from spcola.control import Landmark
from spcola.errors import WorkspaceError
from spcola.formats.images import read_image_data
from spcola.formats.maplets import read_maplet, sigma_path
from spcola.formats.shapes import read_shape
from spcola.formats.solution import read_landmark, read_summary
from spcola.formats.solution.exact_camera import camera_files
from spcola.formats.solution.line_scan import LINE_SCAN_SUFFIX, read_line_scan
from spcola.grids import Maplet
from spcola.shape import Mesh

SETTINGS_FILE = "spcola.toml"
SPC_FOLDERS = ("MAPFILES", "LMKFILES", "SUMFILES", "IMAGEFILES", "SHAPEFILES", "NOMINALS")
SPC_LISTS = ("PICTLIST.TXT", "LMRKLIST.TXT", "MAPLIST.TXT")
# Folders that all solutions share.
_SHARED = ("scans", "IMAGEFILES")
OWN_FOLDERS = ("scans", "mapolas", "fused", "bigmaps", "pairs", "release")


@dataclass(frozen=True)
class Workspace:
    """Paths of all files of a workspace, and their readers.

    Parameters
    ----------
    root : Path
        The folder; it contains ``spcola.toml``, scans, and the pixels of images.
    left_out : frozenset of str
        Maplets to ignore.
    solution : str
        The SPC solution whose maplets, landmarks, states and shape are read, and whose results
        are meant (:mod:`fusion.pipeline.solutions`).
    """

    root: Path
    left_out: frozenset[str] = frozenset()
    solution: str = IMPORTED

    @classmethod
    def open(cls, root: str | Path, solution: str = "") -> Workspace:
        """Open the workspace in the folder `root`.

        Parameters
        ----------
        root : str or Path
        solution : str
            By default the one in use.

        Raises
        ------
        WorkspaceError
            If there is no such folder, or it is no workspace.
        """
        root = Path(root)
        if not root.is_dir():
            raise WorkspaceError("is not a folder", root, f"create it: spcola init {root}")
        if not (root / SETTINGS_FILE).is_file():
            raise WorkspaceError(
                f"is not a workspace: it has no {SETTINGS_FILE}", root, f"run: spcola init {root}"
            )
        name = solution or name_in_use(root)
        if name != IMPORTED:
            read_solution(root, name)
        return cls(root, solution=name)

    @classmethod
    def create(cls, root: str | Path, settings: Settings) -> Workspace:
        """Make `root` a workspace: its folders and settings. Existing files are unchanged.

        Raises
        ------
        WorkspaceError
            If it is a workspace already, or cannot be written.
        """
        root = Path(root)
        if (root / SETTINGS_FILE).exists():
            raise WorkspaceError("is a workspace already", root, f"edit its {SETTINGS_FILE}")
        for folder in (*SPC_FOLDERS, *OWN_FOLDERS):
            make_folder(root / folder)
        write_settings(root / SETTINGS_FILE, settings)
        return cls(root)

    def settings(self) -> Settings:
        """Read ``spcola.toml``, and apply what the solution changed of it; both are checked.

        Raises
        ------
        SettingsError, WorkspaceError
        """
        settings = load_settings(self.root / SETTINGS_FILE)
        record = read_solution(self.root, self.solution)
        return settings.with_tables(record.constants, self.home / SOLUTION_FILE)

    @property
    def home(self) -> Path:
        """The folder of the solution: its SPC files, and all that was made with it."""
        return solution_folder(self.root, self.solution)

    def path_of(self, name: str) -> Path:
        """Return the file whose name in the catalogue (:meth:`relative`) is `name`."""
        return (self.root if name.partition("/")[0] in _SHARED else self.home) / name

    def relative(self, path: Path) -> str:
        """Return `path` as it is named in the catalogue.

        Relative to the folder of the solution where inside it, so that a file has the same name
        in all solutions, or else to the root. A file of another solution is named from the folder
        of this one: ``../lithos-1/MAPFILES/AB0001.MAP``.
        """
        text = str(path)
        for prefix in (f"{self.home}/", f"{self.root}/"):
            # A tenth of the time of comparing paths part by part, which a large workspace feels.
            if text.startswith(prefix) and text.isascii():
                name = text[len(prefix) :]
                return name if prefix == f"{self.home}/" else self._beyond(name)
        if path.is_relative_to(self.home):
            name = path.relative_to(self.home).as_posix()
        elif path.is_relative_to(self.root):
            name = self._beyond(path.relative_to(self.root).as_posix())
        else:
            name = str(path.resolve())
        # The data base stores UTF-8, and a file name may not be UTF-8.
        return name.encode("utf-8", "backslashreplace").decode("utf-8")

    def _beyond(self, name: str) -> str:
        """Return the name of a file in the root that does not belong to this solution."""
        folder, _, rest = name.partition("/")
        if folder == SOLUTION_FOLDER:
            return f"../{rest}"
        return f"../../{name}" if folder in SPC_FOLDERS and folder not in _SHARED else name

    def maplet_names(self) -> list[str]:
        """Return the maplets: those of MAPLIST.TXT or LMRKLIST.TXT, else all in MAPFILES."""
        listed = is_there(self.home / "MAPLIST.TXT")
        listing = self.home / ("MAPLIST.TXT" if listed else "LMRKLIST.TXT")
        names = listed_names(listing, "landmark", "MAPFILES", ".MAP")
        return [name for name in names if name not in self.left_out]

    def maplet_path(self, name: str) -> Path:
        """Return where the maplet `name` lies."""
        return self.home / "MAPFILES" / f"{name}.MAP"

    def maplet_files(self) -> list[Path]:
        """Return the files of all maplets: each .MAP, and its sigma companion where it has one."""
        folder, paths = self.home / "MAPFILES", []
        there = entry_names(folder)
        for name in self.maplet_names():
            map_file = folder / f"{name}.MAP"
            paths.append(map_file)
            if f"{name}.SIG" in there:
                paths.append(sigma_path(map_file))
        return paths

    def maplet(self, name: str) -> Maplet:
        """Read the maplet `name`."""
        return read_maplet(self._present(self.maplet_path(name), "maplet"), name=name)

    def landmark_names(self) -> list[str]:
        """Return the landmarks: those of LMRKLIST.TXT, else all in LMKFILES."""
        return listed_names(self.home / "LMRKLIST.TXT", "landmark", "LMKFILES", ".LMK")

    def landmark_path(self, name: str) -> Path:
        """Return where the landmark `name` lies."""
        return self.home / "LMKFILES" / f"{name}.LMK"

    def landmark(self, name: str) -> Landmark:
        """Read the landmark `name`."""
        return read_landmark(self._present(self.landmark_path(name), "landmark"))

    def image_names(self) -> list[str]:
        """Return the images: those of PICTLIST.TXT, else all in SUMFILES."""
        return listed_names(self.home / "PICTLIST.TXT", "image", "SUMFILES", ".SUM")

    def image_path(self, name: str) -> Path:
        """Return where the SUM file of the image `name` lies."""
        return self.home / "SUMFILES" / f"{name}.SUM"

    def image(self, name: str) -> SpcImage:
        """Read the state of the image `name` (no pixels)."""
        return read_summary(self._present(self.image_path(name), "image"))

    def images(self) -> list[SpcImage]:
        """Read the states of all images (no pixels)."""
        return [self.image(name) for name in self.image_names()]

    def exposure_path(self, name: str) -> Path:
        """Return where the pixels of the image `name` would lie."""
        return self.root / "IMAGEFILES" / f"{name}.DAT"

    def exposed(self, image: SpcImage) -> SpcImage:
        """Return `image` with its pixels, where IMAGEFILES holds them."""
        path = self.exposure_path(image.name)
        if not path.is_file():
            return image
        camera = image.camera
        return replace(image, pixels=read_image_data(path, camera.width, camera.height))

    def line_scan_names(self) -> list[str]:
        """Return the line-scan images with states."""
        return self._stems("SUMFILES", LINE_SCAN_SUFFIX)

    def line_scan_path(self, name: str) -> Path:
        """Return where the states of the line-scan image `name` lie."""
        return self.home / "SUMFILES" / f"{name}{LINE_SCAN_SUFFIX}"

    def line_scan(self, name: str) -> LineScanImage:
        """Read the states of the line-scan image `name` (no pixels)."""
        return read_line_scan(self._present(self.line_scan_path(name), "line-scan image"))

    def state_files(self) -> list[Path]:
        """Return the files of all images' states: each .SUM, and the cameras next to them."""
        summaries = [self.image_path(name) for name in self.image_names()]
        return [*summaries, *camera_files(self.home / "SUMFILES")]

    def image_files(self) -> list[Path]:
        """Return the files of all images: states, and pixels where IMAGEFILES has them."""
        there = entry_names(self.root / "IMAGEFILES")
        exposures = [self.exposure_path(name) for name in self.image_names()]
        return [*self.state_files(), *(path for path in exposures if path.name in there)]

    def shape_path(self) -> Path:
        """Return the shape model's file: the setting, SHAPE.TXT, or the only file there is.

        Raises
        ------
        WorkspaceError
            If there is none, or several and none is chosen.
        """
        folder = self.home / "SHAPEFILES"
        chosen = self.settings().body.shape
        if chosen:
            return self._present(folder / chosen, "shape")
        return shape_file(folder)

    def has_shape(self) -> bool:
        """Return whether there is any file in SHAPEFILES."""
        return bool(visible_files(self.home / "SHAPEFILES"))

    def shape(self) -> Mesh:
        """Read the shape model.

        Raises
        ------
        WorkspaceError
            If its size does not fit the maplets: a wrong unit.
        """
        path = self.shape_path()
        body = self.settings().body
        mesh = read_shape(
            path, unit=body.shape_unit, faces_from=body.faces_from, icq_edges=body.icq_edges
        )
        names = self.maplet_names()
        if names and self.maplet_path(names[0]).is_file():
            check_unit(mesh, path, self.maplet(names[0]))
        return mesh

    def scan_names(self) -> list[str]:
        """Return the imported scans."""
        return self._stems("scans", ".h5")

    def scan_path(self, name: str) -> Path:
        """Return where the scan `name` lies."""
        return self.root / "scans" / f"{name}.h5"

    def scan_paths(self) -> list[Path]:
        """Return where the imported scans lie, in the order of their names."""
        return [self.scan_path(name) for name in self.scan_names()]

    def mapola_names(self) -> list[str]:
        """Return the mapolas."""
        return self._stems("mapolas", ".MAP")

    def mapola_paths(self) -> list[Path]:
        """Return the files of all mapolas: their maps and the HDF5 with the other layers."""
        return visible_files(self.home / "mapolas")

    def mapola(self, name: str) -> Mapola:
        """Read the mapola `name`."""
        self._present(self.home / "mapolas" / f"{name}.MAP", "mapola")
        return read_mapola(self.home / "mapolas", name)

    @property
    def adjustment_path(self) -> Path:
        """Where the displacements of scans lie with which the mapolas were made."""
        return self.home / "mapolas" / ADJUSTMENT_HDF5

    def adjustment(self) -> ScanAdjustment | None:
        """Read the displacements of the scans; None if the mapolas were made without."""
        return read_adjustment(self.adjustment_path) if self.adjustment_path.is_file() else None

    def fused_names(self) -> list[str]:
        """Return the fused maplets."""
        return self._stems("fused", ".MAP")

    def fused_paths(self) -> list[Path]:
        """Return the files of all fused maplets: maps, sigmas and the HDF5 of the rest."""
        return visible_files(self.home / "fused")

    def fused_path(self, name: str) -> Path:
        """Return where the fused maplet `name` lies."""
        return self.home / "fused" / f"{name}.MAP"

    def fused(self, name: str) -> FusedMaplet:
        """Read the fused maplet `name`."""
        self._present(self.fused_path(name), "fused maplet")
        return read_fused(self.home / "fused", name)

    def pair_path(self, image: str, kind: str) -> Path:
        """Return where a bigmap of the pair of `image` lies; `kind` is "maplets" or "returns"."""
        return self.home / "pairs" / f"{image}-{kind}.MAP"

    @property
    def registration_path(self) -> Path:
        """Where the registration lies."""
        return self.home / "registration.json"

    @property
    def photoclinometry_path(self) -> Path:
        """How maplets and images of a solution from images fit."""
        return self.home / "photoclinometry.json"

    @property
    def scale_path(self) -> Path:
        """Where the scale lies."""
        return self.home / "scale.json"

    @property
    def report_path(self) -> Path:
        """Where the report lies."""
        return self.home / "report.html"

    def write_json(self, name: str, content: Mapping[str, Any]) -> Path:
        """Write `content` to the file `name`: atomic, keys sorted, NaN and infinity as null."""
        path = self.home / name
        make_folder(path.parent)
        atomic.write_text(path, json_text(content))
        return path

    def find_json(self, name: str) -> dict[str, Any] | None:
        """Read the file `name` as :meth:`read_json` does; None if it is not there."""
        return self.read_json(name) if (self.home / name).is_file() else None

    def read_json(self, name: str) -> dict[str, Any]:
        """Read the file `name`; null becomes None.

        Raises
        ------
        WorkspaceError
            If it is missing or holds no JSON object.
        """
        return read_object(self.home / name)

    def _stems(self, folder: str, suffix: str) -> list[str]:
        """Return the names of the files with `suffix` in a folder of the workspace, sorted."""
        base = self.root if folder in _SHARED else self.home
        return [name.removesuffix(suffix) for name in visible_names(base / folder, suffix)]

    def _present(self, path: Path, what: str) -> Path:
        """Return `path`, refused unless it is a file."""
        if not path.is_file():
            raise WorkspaceError(f"the {what} is not there", path, f"see: spcola info {self.root}")
        return path
