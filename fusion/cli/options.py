"""Options that several commands share, and what they choose."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand

from fusion.service.commands import Site, SolutionOption
from spcola.errors import SettingsError

if TYPE_CHECKING:
    from fusion.runtime import Executor

WorkspaceArgument = Annotated[Path, typer.Argument(metavar="WS", help="The workspace.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output, nothing else.")
]
WorkersOption = Annotated[
    int | None,
    typer.Option(metavar="N", min=1, max=1024, help="Threads; by default one for each core."),
]
ClusterOption = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Address of a Dask scheduler whose workers do the work. All must reach the workspace "
        "under the same path.",
    ),
]
AcceptOption = Annotated[
    list[str] | None,
    typer.Option(
        "--accept",
        metavar="CODE",
        help="Use a doubtful result in spite of a finding, named by its code: the word in brackets "
        "that is printed with it, such as 'strain'. Repeat it for several. For this run only; "
        "[accept] codes in spcola.toml keeps it.",
    ),
]
WaitOption = Annotated[
    bool,
    typer.Option("--wait", help="Wait while another spcola works with the same solution."),
]


@dataclass(frozen=True)
class WorkOptions:
    """Options of commands that work on a solution, item by item."""

    solution: SolutionOption = ""
    workers: WorkersOption = None
    cluster: ClusterOption = ""
    wait: WaitOption = False
    as_json: JsonOption = False

    def site(self, workspace: Path) -> Site:
        """Return where and with what the command works."""
        return site_of(
            workspace,
            solution=self.solution,
            workers=self.workers,
            cluster=self.cluster,
            wait=self.wait,
            as_json=self.as_json,
        )


@dataclass(frozen=True)
class RunOptions(WorkOptions):
    """Options of all commands that run stages."""

    force: Annotated[bool, typer.Option("--force", help="Run even if up to date.")] = False
    accept: AcceptOption = None
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Make this item alone, a maplet, mapola, image, scan or site by its name; the "
            "others stay as they are. Repeat it for several.",
        ),
    ] = None
    within: Annotated[
        str,
        typer.Option(
            metavar="LAT,LON,RADIUS_M",
            help="Make only items whose centres lie within so many metres of a place, degrees.",
        ),
    ] = ""


@dataclass(frozen=True)
class IsolateOptions:
    """Options of all commands that read files of unknown origin."""

    isolate: Annotated[
        bool,
        typer.Option(
            "--isolate",
            help="Run in a separate process with limited memory and time, for files that may be "
            "damaged or hostile: they can only make that process fail.",
        ),
    ] = False
    limit_mb: Annotated[
        int,
        typer.Option(metavar="MB", min=2048, max=1 << 24, help="With --isolate: limit of memory."),
    ] = 8192
    limit_s: Annotated[
        float,
        typer.Option(metavar="S", min=1.0, max=1e7, help="With --isolate: limit of time, seconds."),
    ] = 3600.0

    def apply(self, folder: Path) -> None:
        """With ``--isolate``, run this command again in another process and end with its exit code.

        Parameters
        ----------
        folder : Path
            Where the command writes.

        Raises
        ------
        typer.Exit
            With the exit code.
        SpcolaError
            If that process died or took too long.
        """
        if not self.isolate:
            return
        from fusion.runtime.processes import ProcessLimits, isolated

        arguments = [argument for argument in sys.argv[1:] if argument != "--isolate"]
        raise typer.Exit(isolated(arguments, ProcessLimits(self.limit_mb, self.limit_s), folder))


def with_shared_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command, instead of a parameter of a class of options, an option for each field.

    Typer reads the options of a command from its signature. A field may be a class of options too.
    The options of a class with a `panel` stand under that heading in the help.
    """
    hints = get_type_hints(command, include_extras=True)
    options: dict[str, Parameter] = {}
    for name, parameter in signature(command).parameters.items():
        if is_dataclass(hints[name]):
            options |= {option.name: option for option in _options_of(hints[name])}
        else:
            options[name] = parameter.replace(annotation=hints[name], kind=Parameter.KEYWORD_ONLY)

    @wraps(command)
    def called(**given: Any) -> None:
        for name, kind in hints.items():
            if is_dataclass(kind):
                given[name] = _value_of(kind, given)
        command(**given)

    called.__annotations__ = {name: option.annotation for name, option in options.items()}
    called.__signature__ = Signature(list(options.values()))  # type: ignore[attr-defined]
    return called


def _options_of(kind: Any) -> Iterator[Parameter]:
    """Yield an option for each field of a class of options."""
    types = get_type_hints(kind, include_extras=True)
    panel = getattr(kind, "panel", None)
    for field in fields(kind):
        annotation = types[field.name]
        if is_dataclass(annotation):
            yield from _options_of(annotation)
            continue
        if panel is not None:
            value, option, *_ = get_args(annotation)
            option = copy(option)
            option.rich_help_panel = panel
            annotation = Annotated[value, option]
        default = Parameter.empty if field.default is MISSING else field.default
        yield Parameter(field.name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _value_of(kind: Any, given: dict[str, Any]) -> Any:
    """Return a class of options with the values of a call, which are removed from `given`."""
    types = get_type_hints(kind)
    return kind(
        **{
            field.name: _value_of(types[field.name], given)
            if is_dataclass(types[field.name])
            else given.pop(field.name)
            for field in fields(kind)
        }
    )


class PanelCommand(TyperCommand):
    """A command whose help has its options under headings, in the order of the signature."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then options by their heading."""
        panels: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                named = "Arguments" if parameter.param_type_name == "argument" else "Options"
                panel = getattr(parameter, "rich_help_panel", None) or named
                panels.setdefault(panel, []).append(record)
        # What every command has comes last.
        panels["Options"] = panels.pop("Options")
        for panel, records in panels.items():
            if records:
                with formatter.section(panel):
                    formatter.write_dl(records)


def site_of(
    workspace: Path,
    *,
    solution: str = "",
    workers: int | None = None,
    cluster: str = "",
    wait: bool = False,
    as_json: bool = False,
) -> Site:
    """Return where and with what a command works; raises as `executor_of`."""
    from fusion.runtime import Progress

    progress = Progress.fitting(silent=as_json)
    root = shared_path(workspace, cluster)
    return Site(root, executor_of(workers, cluster), progress, solution, wait)


def executor_of(workers: int | None, cluster: str) -> Executor:
    """Return the executor that ``--workers`` and ``--cluster`` choose.

    Raises
    ------
    typer.BadParameter
        If both are given.
    SettingsError
        If the cluster cannot be used.
    """
    if not cluster:
        from fusion.runtime import ThreadExecutor

        return ThreadExecutor(workers)
    if workers is not None:
        raise typer.BadParameter("a cluster has its own workers", param_hint="--workers")
    try:
        from fusion.runtime import ClusterExecutor
    except ImportError as error:
        raise SettingsError(
            "needs Dask", "--cluster", "install it: pip install 'spcola[cluster]'"
        ) from error
    return ClusterExecutor(cluster)


def shared_path(path: Path, cluster: str) -> Path:
    """Return a path that is valid for the workers of a cluster in their folder too."""
    return path.absolute() if cluster else path
