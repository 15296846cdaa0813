"""Tokens: their secrets are random, and only hashes of them are stored.

A slow hash (argon2, bcrypt) makes guessing of passwords costly, because people choose few. A
secret of 256 random bits cannot be guessed at any speed, so SHA-256 protects it as well: who reads
the store cannot find a secret that has the hash. A slow one would cost every request 50 ms.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from sqlalchemy import Row, select

from fusion.service.store.database import Database
from fusion.service.store.errors import StoreError, StoreFault
from fusion.service.store.records import Scope, Token
from fusion.service.store.rows import stored, time_of
from fusion.service.store.schema import TOKEN
from spcola.errors import InvalidValueError

_PREFIX = "spcola_"  # programs that look for published secrets find it
_USE_NOTED_S = 60.0


class Tokens:
    """The tokens of a store."""

    def __init__(self, database: Database, clock: Callable[[], float]) -> None:
        self._database = database
        self._clock = clock

    def make(
        self,
        user: str,
        scopes: Mapping[str, Scope],
        *,
        name: str = "",
        lifetime_s: float | None = None,
    ) -> tuple[str, Token]:
        """Make a token; return its secret, which cannot be read again, and the token.

        Raises
        ------
        InvalidValueError
            If it has no user or no scope, or its lifetime is not positive.
        """
        if not user or not scopes:
            raise InvalidValueError("a token needs a user and a scope", "token")
        if lifetime_s is not None and not 0.0 < lifetime_s < 1e10:
            raise InvalidValueError("the lifetime has to be positive", "token")
        secret = _PREFIX + secrets.token_urlsafe(32)
        now = self._clock()
        values = {
            "id": secrets.token_hex(6),
            "owner": user,
            "name": name,
            "scopes": stored({place: Scope(scope).value for place, scope in scopes.items()}),
            "created": now,
            "expires": None if lifetime_s is None else now + lifetime_s,
        }
        with self._database.writing() as connection:
            connection.execute(TOKEN.insert().values(digest=_digest(secret), **values))
            row = connection.execute(select(TOKEN).where(TOKEN.c.id == values["id"])).one()
            return secret, _token(row)

    def check(self, secret: str) -> Token:
        """Return the token of a secret.

        Raises
        ------
        StoreError
            `REFUSED_TOKEN` if the secret is unknown, or its token expired or was revoked.
        """
        with self._database.reading() as connection:
            row = connection.execute(select(TOKEN).where(TOKEN.c.digest == _digest(secret))).first()
        now = self._clock()
        if row is None or row.revoked is not None:
            raise _refused("is unknown or was revoked")
        if row.expires is not None and row.expires <= now:
            # It stays refused when the clock is set back.
            self._change(row.id, revoked=now)
            raise _refused("has expired")
        if row.last_used is None or abs(now - row.last_used) > _USE_NOTED_S:
            # Who reads on a full disk is not sent away because the time cannot be noted.
            with suppress(StoreError):
                self._change(row.id, last_used=now)
        return _token(row)

    def all(self) -> list[Token]:
        """Return all tokens, also the revoked ones, the oldest first."""
        with self._database.reading() as connection:
            query = select(TOKEN).order_by(TOKEN.c.created, TOKEN.c.id)
            return [_token(row) for row in connection.execute(query)]

    def revoke(self, identity: str) -> None:
        """Revoke a token, from the next request on.

        Raises
        ------
        StoreError
            `UNKNOWN_TOKEN` if there is none with this id.
        """
        if not self._change(identity, revoked=self._clock()):
            raise StoreError(StoreFault.UNKNOWN_TOKEN, "there is no such token", identity[:60])

    def _change(self, identity: str, **values: float) -> bool:
        with self._database.writing() as connection:
            update = TOKEN.update().where(TOKEN.c.id == identity).values(**values)
            return bool(connection.execute(update).rowcount)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "backslashreplace")).hexdigest()


def _refused(what: str) -> StoreError:
    return StoreError(StoreFault.REFUSED_TOKEN, what, "token", "ask an administrator for a new one")


def _token(row: Row[Any]) -> Token:
    return Token(
        row.id,
        row.owner,
        row.name,
        {place: Scope(scope) for place, scope in json.loads(row.scopes).items()},
        row.created,
        time_of(row.expires),
        time_of(row.revoked),
        time_of(row.last_used),
    )
