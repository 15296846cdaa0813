"""``spcola photometry``: photometric functions of a solution's images."""

from __future__ import annotations

import typer

from fusion.cli.folder import remember_info
from fusion.cli.options import PanelCommand, WorkOptions, WorkspaceArgument, with_shared_options
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.service.commands.photometry import FitOptions, fit_functions

app = typer.Typer(
    name="photometry",
    help="Fit photometric functions to images.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.callback()
def _group() -> None:
    """Fit photometric functions to images."""


def fit(
    workspace: WorkspaceArgument,
    given: FitOptions = FitOptions(),
    work: WorkOptions = WorkOptions(),
) -> None:
    """Fit photometric functions to the images of a solution over its maplets.

    Each image has a scale of its own, which is eliminated. The functions are compared: χ², AIC and
    BIC by the number of independent places. photometry.json of the solution has the parameters with
    their covariance, for each filter; the last line is the setting of the preferred function.
    """
    show(*fit_functions(work.site(workspace), given), as_json=work.as_json)
    remember_info(workspace)


app.command(
    "fit",
    cls=PanelCommand,
    epilog='Example: spcola photometry fit bennu --function minnaert --function "hapke h=0.1"',
)(guarded(with_shared_options(fit)))
