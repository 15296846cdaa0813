"""``spcola serve token``: who may do what over the network."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

import typer

from fusion.cli.options import JsonOption, PanelCommand, with_shared_options
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.cli.service_folder import ServiceFolder

if TYPE_CHECKING:
    from fusion.service.store import Token

_DAY_S = 86_400.0

app = typer.Typer(
    name="token",
    help="Tokens: who may do what over the network.",
    epilog="Example: spcola serve token add missions anna --scope run --workspace bennu",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@dataclass(frozen=True)
class NewToken:
    """Whose token it is, and what it allows."""

    user: Annotated[str, typer.Argument(metavar="USER", help="In whose name it acts.")]
    scope: Annotated[str, typer.Option(help="read, run (with read) or admin (with both).")] = "read"
    workspace: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Where; by default in all. Repeat it for several."),
    ] = None
    days: Annotated[
        float | None, typer.Option(metavar="D", min=0.001, max=36_500.0, help="Until it expires.")
    ] = None
    label: Annotated[str, typer.Option(metavar="TEXT", help="What it is for.")] = ""


def add(service: ServiceFolder, new: NewToken, as_json: JsonOption = False) -> None:
    """Make a token and print its secret, which cannot be read again."""
    from fusion.service.store import Scope

    if new.scope not in list(Scope):
        what = f"{new.scope!r} is none of {', '.join(Scope)}"
        raise typer.BadParameter(what, param_hint="--scope")
    scopes = dict.fromkeys(new.workspace or ["*"], Scope(new.scope))
    lifetime_s = None if new.days is None else new.days * _DAY_S
    with service.opened() as store:
        secret, token = store.tokens.make(new.user, scopes, name=new.label, lifetime_s=lifetime_s)
    show({**asdict(token), "secret": secret}, [secret], as_json=as_json)


def list_(service: ServiceFolder, as_json: JsonOption = False) -> None:
    """List the tokens, without their secrets."""
    with service.opened() as store:
        found = store.tokens.all()
    lines = [_line_of(token) for token in found] or ["no tokens"]
    show({"tokens": [asdict(token) for token in found]}, lines, as_json=as_json)


def revoke(
    service: ServiceFolder,
    token: Annotated[str, typer.Argument(metavar="ID", help="From spcola serve token list.")],
    as_json: JsonOption = False,
) -> None:
    """Revoke a token; a running service refuses it within two seconds."""
    with service.opened() as store:
        store.tokens.revoke(token)
    show({"revoked": token}, [f"{token}: revoked"], as_json=as_json)


def _line_of(token: Token) -> str:
    where = ", ".join(f"{scope.value} in {place}" for place, scope in token.scopes.items())
    state = "revoked" if not math.isnan(token.revoked) else "valid"
    if not math.isnan(token.expires) and state == "valid":
        state = f"until {datetime.fromtimestamp(token.expires, UTC):%Y-%m-%d %H:%M} UTC"
    return f"{token.id}  {token.user}  {where}  {state}  {token.name}".rstrip()


for _name, _command, _example in (
    ("add", add, "spcola serve token add missions anna --scope run --days 90"),
    ("list", list_, "spcola serve token list missions"),
    ("revoke", revoke, "spcola serve token revoke missions 4f1d2c3b5a69"),
):
    app.command(_name, cls=PanelCommand, epilog=f"Example: {_example}")(
        guarded(with_shared_options(_command))
    )
