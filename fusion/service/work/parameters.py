"""What each kind of job takes: JSON of users, checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fusion.service.jobs import JobKind
from fusion.workspace.settings import problem_text
from spcola.errors import InvalidValueError, SettingsError

UploadId = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
_Text = Annotated[str, Field(max_length=1000)]
_Texts = Annotated[list[_Text], Field(max_length=100_000)]
_Uploads = Annotated[list[UploadId], Field(min_length=1, max_length=100_000)]
_Count = Annotated[int, Field(ge=1, le=200_000)]


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


class ImportParameters(_Parameters):
    """Uploaded lidar files; `name` of the scan of one file, the others as in the command."""

    uploads: _Uploads
    name: _Text = ""
    format: _Text = ""
    columns: dict[_Text, _Text] = {}
    unit: _Text = ""
    gps_time: bool = False


class ImagesParameters(_Parameters):
    """Uploaded images; `poses`, `camera`, `times`, `pck`, `dark` and `flat` are uploads too."""

    uploads: _Uploads
    solution: _Text = ""
    letter: _Text = ""
    filters: _Texts = []
    size: tuple[_Count, _Count] | None = None
    states: Literal["", "label", "poses"] = ""
    poses: UploadId | None = None
    camera: UploadId | None = None
    times: UploadId | None = None
    pck: UploadId | None = None
    columns: dict[_Text, _Text] = {}
    dark: UploadId | None = None
    flat: UploadId | None = None
    dark_scale: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.0
    bits: Literal[8, 16] | None = None
    orientation: _Text = "as-stored"


class InitParameters(_Parameters):
    """A new workspace: a shape, or SPC files, each known by its name; both are uploads."""

    body: Annotated[str, Field(min_length=1, max_length=100)] = "body"
    uploads: Annotated[list[UploadId], Field(max_length=100_000)] = []
    shape: UploadId | None = None
    shape_unit: Literal["km", "m"] = "km"
    faces_from: Literal[0, 1] = 1


PARAMETERS: Mapping[JobKind, type[_Parameters]] = {
    JobKind.RUN: RunParameters,
    JobKind.IMPORT: ImportParameters,
    JobKind.IMAGES: ImagesParameters,
    JobKind.INIT: InitParameters,
    JobKind.FORECAST: RunParameters,
}


def parameters_of(kind: JobKind, given: Mapping[str, Any]) -> _Parameters:
    """Return the checked parameters of a job.

    Parameters
    ----------
    kind : JobKind
    given : mapping
        JSON of a user.

    Raises
    ------
    InvalidValueError
        If one is unknown, missing or not allowed; it is named.
    SettingsError
        If a setting leads out of the workspace.
    """
    try:
        found = PARAMETERS[kind].model_validate(dict(given))
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(str(part)[:60] for part in problem["loc"])
        raise InvalidValueError(problem_text(problem), f"{kind.value}: {where}") from error
    if isinstance(found, RunParameters):
        _check_paths(found.settings)
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
