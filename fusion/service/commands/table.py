"""Commands by the kind of job that does the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fusion.service.commands.albedo import AlbedoCommandOptions, solve_albedos
from fusion.service.commands.altimetry import ImportOptions, import_lidar
from fusion.service.commands.assessment import AssessOptions, assess_models
from fusion.service.commands.calibration import CalibrateOptions, calibrate_camera
from fusion.service.commands.camera_files import ConvertOptions, convert_cameras
from fusion.service.commands.images import ImagesOptions, bring_images
from fusion.service.commands.lithos import (
    ImageFusionOptions,
    LithosCommandOptions,
    fuse_images,
    solve_maplets,
)
from fusion.service.commands.looking import (
    DifferenceOptions,
    InfoOptions,
    LookOptions,
    compare_solutions,
    describe,
    draw_in_workspace,
)
from fusion.service.commands.photometry import FitOptions, fit_functions
from fusion.service.commands.site import Done, Site
from fusion.service.commands.solutions import (
    ExportOptions,
    SolutionName,
    export_to_folder,
    put_in_use,
    remove_version,
)
from fusion.service.commands.spc_register import RegisterCommandOptions, register_images
from fusion.service.commands.states import (
    KernelsOptions,
    SumfilesOptions,
    make_kernels,
    make_states,
)
from fusion.service.commands.tiling import TileOptions, tile_maplets
from fusion.service.jobs import JobKind

__all__ = ["COMMANDS", "Command"]


@dataclass(frozen=True)
class Command:
    """A command that a job can do.

    Parameters
    ----------
    name : str
        As it is typed after ``spcola``.
    options : type
        Dataclass of its options; each field is a parameter of the job.
    perform : callable
    solution : bool
        Whether it takes ``--solution``.
    reads_files : bool
        Whether it reads files of users: with limits of memory and time then.
    together : bool
        Whether its files may name each other, so that they have to lie in one folder.
    companions : bool
        Whether they may name further ones: labels their pixels.
    """

    name: str
    options: type[Any]
    perform: Callable[[Site, Any], Done]
    solution: bool = False
    reads_files: bool = True
    together: bool = True
    companions: bool = False


COMMANDS: Mapping[JobKind, Command] = {
    JobKind.IMPORT: Command("import", ImportOptions, import_lidar, together=False),
    JobKind.IMAGES: Command("images", ImagesOptions, bring_images, solution=True, companions=True),
    JobKind.SUMFILES: Command("sumfiles", SumfilesOptions, make_states, companions=True),
    JobKind.KERNELS: Command("kernels", KernelsOptions, make_kernels),
    JobKind.PHOTOMETRY_FIT: Command(
        "photometry fit", FitOptions, fit_functions, solution=True, reads_files=False
    ),
    JobKind.SPC_TILE: Command(
        "spc tile", TileOptions, tile_maplets, solution=True, reads_files=False
    ),
    JobKind.SPC_REGISTER: Command(
        "spc register", RegisterCommandOptions, register_images, solution=True, reads_files=False
    ),
    JobKind.SPC_LITHOS: Command(
        "spc lithos", LithosCommandOptions, solve_maplets, solution=True, reads_files=False
    ),
    JobKind.FUSE_IMAGES: Command(
        "fuse --from images", ImageFusionOptions, fuse_images, solution=True, reads_files=False
    ),
    JobKind.SPC_ALBEDO: Command(
        "spc albedo", AlbedoCommandOptions, solve_albedos, solution=True, reads_files=False
    ),
    JobKind.SOLUTION_USE: Command("solution use", SolutionName, put_in_use, reads_files=False),
    JobKind.SOLUTION_EXPORT: Command(
        "solution export", ExportOptions, export_to_folder, reads_files=False
    ),
    JobKind.SOLUTION_REMOVE: Command(
        "solution remove", SolutionName, remove_version, reads_files=False
    ),
    JobKind.TRUTH_ASSESS: Command("truth assess", AssessOptions, assess_models),
    JobKind.CAMERA_CALIBRATE: Command("camera calibrate", CalibrateOptions, calibrate_camera),
    JobKind.CAMERA_CONVERT: Command("camera convert", ConvertOptions, convert_cameras),
    JobKind.INFO: Command("info", InfoOptions, describe),
    JobKind.LOOK: Command("look", LookOptions, draw_in_workspace),
    JobKind.SOLUTION_DIFF: Command(
        "solution diff", DifferenceOptions, compare_solutions, reads_files=False
    ),
}
"""What `run`, `forecast`, `scale-apply` and `init` do is in `fusion.service.work.kinds`."""
