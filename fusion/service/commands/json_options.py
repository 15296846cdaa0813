"""Options of commands as JSON: one model of each class, made from its fields."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import typer
from pydantic import BaseModel, ConfigDict, Field, create_model
from typer.models import ParameterInfo

from fusion.service.commands.fields import Mark, named_columns
from spcola.errors import InvalidValueError

__all__ = [
    "FileName",
    "Output",
    "UploadId",
    "json_of",
    "options_model",
    "options_of",
    "outputs_of",
    "writes_outputs",
    "wrong_usage",
]

UploadId = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
_NAME = r"[A-Za-z0-9][A-Za-z0-9._+-]{0,127}"
OutputName = Annotated[str, Field(pattern=f"^{_NAME}$")]
_MOST = 100_000
_Text = Annotated[str, Field(max_length=1000)]
_CONFIG = ConfigDict(extra="forbid", frozen=True)


class Output(BaseModel):
    """A file that an earlier job has written: its name, or of a folder ``name/file``."""

    model_config = _CONFIG

    output: Annotated[str, Field(pattern=f"^{_NAME}(/{_NAME})?$")]


FileName = UploadId | Output
_COMPANIONS = Annotated[
    list[FileName],
    Field(
        max_length=_MOST,
        description="Files that lie with the others: pixels of a detached label, labels of "
        "images, ISD files.",
        json_schema_extra={"x-takes": "file"},
    ),
]
_MARKED: dict[Mark, Any] = {
    Mark.OUTPUT: OutputName,
    Mark.FOLDER: Annotated[list[FileName], Field(min_length=1, max_length=_MOST)],
    Mark.COLUMNS: Annotated[dict[_Text, _Text], Field(max_length=_MOST)],
}


@dataclass(frozen=True)
class _Leaf:
    """One option: its name, type, and what typer is given of it."""

    name: str
    kind: Any
    info: ParameterInfo
    mark: Mark | None
    default: Any
    panel: str

    @property
    def json_name(self) -> str:
        """Files of users are uploads."""
        return "uploads" if self.name == "files" else self.name

    @property
    def about(self) -> str:
        """The help text; it names options as JSON does."""
        text = " ".join((self.info.help or "").split())
        return re.sub(r"--([a-z][a-z0-9-]*)", lambda found: found[1].replace("-", "_"), text)

    @property
    def hints(self) -> dict[str, str]:
        """What a form needs besides the type: heading, form of the text, what a name names."""
        parts = (self.bare, *get_args(self.bare))
        takes = self.mark.value if self.mark else "file" if Path in parts else ""
        hints = {"x-panel": self.panel, "x-form": self.info.metavar or "", "x-takes": takes}
        return {name: value for name, value in hints.items() if value}

    @property
    def bare(self) -> Any:
        """The type without None."""
        parts = [part for part in get_args(self.kind) if part is not NoneType]
        return parts[0] if NoneType in get_args(self.kind) and len(parts) == 1 else self.kind

    @property
    def json_type(self) -> Any:
        """The type in JSON."""
        optional = NoneType in get_args(self.kind)
        kind = self._json_of(self.bare)
        return Union[kind, None] if optional else kind  # noqa: UP007  the type is made here

    def _json_of(self, kind: Any) -> Any:
        if self.mark is not None:
            return _MARKED[self.mark]
        if get_origin(kind) is list:
            least = 1 if self.name == "files" else 0
            part: Any = self._json_of(get_args(kind)[0])
            return Annotated[list[part], Field(min_length=least, max_length=_MOST)]
        if kind in (int, float):
            limits: dict[str, Any] = {"ge": self.info.min, "le": self.info.max}
            return Annotated[kind, Field(allow_inf_nan=False, strict=kind is int, **limits)]
        return {Path: FileName, str: _Text}.get(kind, kind)


def _leaves(options: type[Any]) -> Iterator[_Leaf]:
    types = get_type_hints(options, include_extras=True)
    panel = getattr(options, "panel", "")
    for field in fields(options):
        annotation = types[field.name]
        if is_dataclass(annotation):
            yield from _leaves(annotation)  # type: ignore[arg-type]  # a class
            continue
        kind, *extras = get_args(annotation)
        info = next(one for one in extras if isinstance(one, ParameterInfo))
        mark = next((one for one in extras if isinstance(one, Mark)), None)
        yield _Leaf(field.name, kind, info, mark, field.default, panel)


def json_of(
    options: type[Any], given: Mapping[str, Any], send: Callable[[Path], str]
) -> dict[str, Any]:
    """Return options as the parameters of a job: the inverse of :func:`options_of`.

    Parameters
    ----------
    options : type
        Dataclass of options for typer.
    given : mapping
        Values by the names of the options; those with their defaults are left out.
    send : callable
        Uploads a file, and returns the id.
    """

    def value_of(leaf: _Leaf, value: Any) -> Any:
        if leaf.mark is Mark.OUTPUT:
            return Path(value).name
        if leaf.mark is Mark.FOLDER:
            return [send(path) for path in sorted(value.iterdir()) if path.is_file()]
        if leaf.mark is Mark.COLUMNS:
            parts = (part for text in value for part in text.split(","))
            return named_columns(parts, "NAME=COLUMN")
        if isinstance(value, list | tuple):
            return [send(one) if isinstance(one, Path) else one for one in value]
        return send(value) if isinstance(value, Path) else value

    chosen = (leaf for leaf in _leaves(options) if given[leaf.name] not in (None, leaf.default))
    return {leaf.json_name: value_of(leaf, given[leaf.name]) for leaf in chosen}


def outputs_of(options: type[Any], given: Mapping[str, Any]) -> list[Path]:
    """Return the files and folders that a command is to write, of options as :func:`json_of`."""
    marked = (leaf for leaf in _leaves(options) if leaf.mark is Mark.OUTPUT)
    return [Path(given[leaf.name]) for leaf in marked if given[leaf.name] is not None]


def options_model(
    name: str, options: type[Any], *, solution: bool, companions: bool, about: str = ""
) -> type[BaseModel]:
    """Return the model of a command's options: the same names, limits and defaults.

    Files are ids of uploads, or outputs of earlier jobs; a folder is a list of files; columns are
    an object; the files of the command are `uploads`. In the schema of a parameter ``x-panel`` is
    the heading that it has in the command's help, ``x-form`` the form of its text, and ``x-takes``
    what its names are of: file, folder, output or columns.

    Parameters
    ----------
    name : str
        Of the model.
    options : type
        Dataclass of options for typer.
    solution : bool
        Whether the job takes the name of a solution too.
    companions : bool
        Whether it takes files that others of the job name.
    about : str
        What the command does.
    """
    named = Field("", description="The SPC solution; by default the one in use.")
    content: dict[str, Any] = {"solution": (_Text, named)} if solution else {}
    for leaf in _leaves(options):
        default = ... if leaf.default is MISSING else leaf.default
        hints: Any = leaf.hints
        described = Field(default, description=leaf.about, json_schema_extra=hints)
        content[leaf.json_name] = (leaf.json_type, described)
    if companions:
        content["companions"] = (_COMPANIONS, [])
    model: type[BaseModel] = create_model(name, __config__=_CONFIG, __doc__=about, **content)
    return model


def writes_outputs(options: type[Any]) -> bool:
    """Return whether a command writes files for its user, outside of the workspace."""
    return any(leaf.mark is Mark.OUTPUT for leaf in _leaves(options))


def options_of(
    options: type[Any], given: BaseModel, path_of: Callable[[Any, Mark | None], Path]
) -> Any:
    """Return the options of a command from their model.

    Parameters
    ----------
    options : type
    given : BaseModel
        Of :func:`options_model`.
    path_of : callable
        Returns the path of a file, a folder or an output in JSON.

    Raises
    ------
    InvalidValueError
        If options contradict each other.
    """
    leaves = {leaf.name: leaf for leaf in _leaves(options)}
    values = {name: _value(leaf, given, path_of) for name, leaf in leaves.items()}
    made = _filled(options, values)
    if hasattr(made, "check"):
        wrong_usage(made.check)()
    return made


def wrong_usage(call: Callable[[], Any]) -> Callable[[], Any]:
    """Return a call whose errors of usage are those of a value.

    Raises
    ------
    InvalidValueError
    """

    def checked() -> Any:
        try:
            return call()
        except typer.BadParameter as error:
            where = str(error.param_hint or "").removeprefix("--").replace("-", "_").lower()
            where = "uploads" if where == "file" else where
            raise InvalidValueError(error.message.replace("--", ""), where or None) from error

    return checked


def _value(leaf: _Leaf, given: BaseModel, path_of: Callable[[Any, Mark | None], Path]) -> Any:
    """Return the value of one option."""
    value = getattr(given, leaf.json_name)
    if value is None:
        return None
    if leaf.mark is Mark.COLUMNS:
        return [f"{name}={column}" for name, column in value.items()]
    if leaf.mark is not None or leaf.bare is Path:
        return path_of(value, leaf.mark)
    if get_origin(leaf.bare) is list and get_args(leaf.bare) == (Path,):
        return [path_of(one, None) for one in value]
    check = leaf.info.callback
    if check is not None:
        wrong_usage(lambda: check(value))()
    return value


def _filled(options: type[Any], values: Mapping[str, Any]) -> Any:
    types = get_type_hints(options)
    return options(
        **{
            field.name: _filled(types[field.name], values)
            if is_dataclass(types[field.name])
            else values[field.name]
            for field in fields(options)
        }
    )
