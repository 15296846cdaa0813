"""What each kind of job takes: JSON of users, checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fusion.service.commands.json_options import UploadId, options_model
from fusion.service.commands.stages import check_stages
from fusion.service.commands.table import COMMANDS
from fusion.service.jobs import JobKind
from fusion.workspace.settings import problem_text
from spcola.errors import InvalidValueError, SettingsError

_Text = Annotated[str, Field(max_length=1000)]
_Texts = Annotated[list[_Text], Field(max_length=100_000)]


class _Parameters(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RunParameters(_Parameters):
    """Stages of a workspace; all that are not up to date if none is named."""

    stages: Annotated[list[_Text], Field(max_length=20)] = []
    settings: dict[_Text, dict[_Text, Any]] = {}
    solution: _Text = ""
    only: _Texts = []
    within: _Text = ""
    accept: _Texts = []
    force: bool = False


class ApplyParameters(_Parameters):
    """A scaled solution: its name (``scaled-1``, … if empty), and how the scale is estimated."""

    name: Annotated[_Text, Field(description="Of the new solution.")] = ""
    settings: Annotated[
        dict[_Text, dict[_Text, Any]], Field(description="Tables as in spcola.toml.")
    ] = {}
    solution: Annotated[
        _Text, Field(description="The one that is scaled; by default the one in use.")
    ] = ""
    accept: Annotated[_Texts, Field(description="Codes of findings that are accepted.")] = []
    force: Annotated[bool, Field(description="Estimate the scale again.")] = False


class InitParameters(_Parameters):
    """A new workspace: a shape, or SPC files, each known by its name; both are uploads."""

    body: Annotated[str, Field(min_length=1, max_length=100, description="Name of the body.")] = (
        "body"
    )
    uploads: Annotated[
        list[UploadId],
        Field(
            max_length=100_000,
            description="SPC files: maplets, landmarks, states, images, lists, solution.json.",
            json_schema_extra={"x-takes": "file"},
        ),
    ] = []
    shape: Annotated[
        UploadId | None,
        Field(description="Shape of a new workspace.", json_schema_extra={"x-takes": "file"}),
    ] = None
    shape_unit: Annotated[
        Literal["km", "m"], Field(description="Unit of a shape that states none.")
    ] = "km"
    faces_from: Annotated[
        Literal[0, 1], Field(description="Number of the first vertex in the facets of a shape.")
    ] = 1


PARAMETERS: Mapping[JobKind, type[BaseModel]] = {
    JobKind.RUN: RunParameters,
    JobKind.FORECAST: RunParameters,
    JobKind.SCALE_APPLY: ApplyParameters,
    JobKind.INIT: InitParameters,
    **{
        kind: options_model(
            f"{kind.value} options",
            one.options,
            solution=one.solution,
            companions=one.companions,
            about=(one.perform.__doc__ or "").partition("\n")[0],
        )
        for kind, one in COMMANDS.items()
    },
}
"""What each kind of job takes."""

EXAMPLES: Mapping[JobKind, Mapping[str, Any]] = {
    JobKind.RUN: {"stages": ["mapolas", "register"], "settings": {"mapolas": {"gsd_m": 0.2}}},
    JobKind.FORECAST: {"stages": ["fuse"]},
    JobKind.SCALE_APPLY: {"name": "scaled-1", "accept": ["below-three-sigmas"]},
    JobKind.INIT: {"body": "Bennu", "uploads": ["k3v9"], "shape": None},
    JobKind.IMPORT: {"uploads": ["k3v9"], "columns": {"x": "X [km]", "y": "Y [km]", "z": "Z [km]"}},
    JobKind.IMAGES: {
        "uploads": ["k3v9", "x07a"], "states": "spice", "kernel": ["m2b1", "m2b2"],
        "frame": "ORX_OCAMS_MAPCAM", "camera": {"output": "mapcam.toml"}, "dark": "d1f4",
        "report": True,
    },
    JobKind.SUMFILES: {
        "table": "t5c0", "kernel": ["m2b1", "m2b2"], "frame": "ORX_OCAMS_MAPCAM",
        "camera": {"output": "mapcam.toml"}, "sigma_m": 2.0, "sigma_mrad": 0.1,
    },
    JobKind.KERNELS: {"out": "kernels-2026-11", "pck": "m2b3"},
    JobKind.PHOTOMETRY_FIT: {"function": ["minnaert", "hapke-rough B0=1 h=0.06"]},
    JobKind.SPC_TILE: {"gsd": 0.35, "within": "56,43,20", "name": "tiled-1"},
    JobKind.SPC_REGISTER: {"position_sigma": 100.0, "name": "registered-1"},
    JobKind.SPC_LITHOS: {
        "only": ["TR0001"], "constraint": ["shape", "lidar"], "map": ["m4p1"], "map_sigma": 0.5,
        "name": "lithos-1",
    },
    JobKind.FUSE_IMAGES: {"within": "56,43,20", "name": "spcola-1"},
    JobKind.SPC_ALBEDO: {"ground": "mapolas", "within": "56,43,20", "name": "albedo-1"},
    JobKind.SOLUTION_USE: {"name": "scaled-1"},
    JobKind.SOLUTION_EXPORT: {"name": "scaled-1", "folder": "spc-scaled"},
    JobKind.SOLUTION_REMOVE: {"name": "scaled-1"},
    JobKind.TRUTH_ASSESS: {"truth": "j8q2", "report": "truth.html", "solution": "all"},
    JobKind.CAMERA_CALIBRATE: {
        "camera": "c4e1", "catalogue": "s9d3", "attitudes": "a6f7", "stars": "b2k5",
        "out": "nac_calibrated.toml",
    },
    JobKind.CAMERA_CONVERT: {"uploads": ["m2b4", "m2b5"], "number": -64361, "out": "mapcam.toml"},
    JobKind.INFO: {"file": "MAPFILES/AB0001.MAP"},
    JobKind.LOOK: {"file": "MAPFILES/AB0001.MAP", "out": "AB0001.png"},
    JobKind.SOLUTION_DIFF: {"first": "imported", "second": "scaled-1", "out": "diff.png"},
}  # fmt: skip
"""Parameters of one job of each kind."""


def parameters_of(kind: JobKind, given: Mapping[str, Any]) -> BaseModel:
    """Return the checked parameters of a job.

    Parameters
    ----------
    kind : JobKind
    given : mapping
        JSON of a user.

    Raises
    ------
    InvalidValueError
        If one is unknown, missing or not allowed; it is named. If there is no such stage, those
        that there are.
    SettingsError
        If a setting leads out of the workspace.
    """
    try:
        found = PARAMETERS[kind].model_validate(dict(given))
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(str(part)[:60] for part in problem["loc"])
        raise InvalidValueError(problem_text(problem), f"{kind.value}: {where}") from error
    if isinstance(found, RunParameters | ApplyParameters):
        _check_paths(found.settings)
    if isinstance(found, RunParameters):
        check_stages(found.stages, found.only, found.within)
    return found


def _check_paths(tables: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse settings that name files outside the workspace, whichever settings these are."""
    for table, content in tables.items():
        for key, value in content.items():
            for text in _texts(value):
                if PurePath(text).is_absolute() or ".." in PurePath(text).parts:
                    raise SettingsError(
                        "must not lead out of the workspace",
                        f"[{table}] {key}",
                        "name a file in it",
                    )


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts in JSON."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for part in (*value.keys(), *value.values()):
            yield from _texts(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _texts(part)
