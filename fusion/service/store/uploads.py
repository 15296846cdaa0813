"""Records of uploads: how much of each file has been written."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

from sqlalchemy import Connection, Row, select

from fusion.service.store.database import Database
from fusion.service.store.errors import StoreError, StoreFault
from fusion.service.store.records import Upload, UploadState
from fusion.service.store.schema import UPLOAD
from spcola.errors import InvalidValueError

_OPEN = UploadState.OPEN.value


class Uploads:
    """The uploads of a store."""

    def __init__(self, database: Database, clock: Callable[[], float]) -> None:
        self._database = database
        self._clock = clock

    def add(self, upload: Upload) -> Upload:
        """Record an upload that begins; the store gives its id and times."""
        if upload.size < 0:
            raise InvalidValueError("the size is negative", "upload")
        now = self._clock()
        new = replace(upload, id=secrets.token_hex(16), offset=0, created=now, changed=now)
        values = {**asdict(new), "owner": new.user}
        del values["user"]
        with self._database.writing() as connection:
            connection.execute(UPLOAD.insert().values(**values))
        return new

    def get(self, identity: str) -> Upload:
        """Return an upload; raises `StoreError` with `UNKNOWN_UPLOAD`."""
        with self._database.reading() as connection:
            return _upload(_row(connection, identity))

    def kept(self, workspace: str = "") -> list[Upload]:
        """Return the uploads that take space: not the removed ones. Oldest first.

        Parameters
        ----------
        workspace : str
            Only those of this one; empty for all.
        """
        query = select(UPLOAD).where(UPLOAD.c.state != UploadState.REMOVED.value)
        if workspace:
            query = query.where(UPLOAD.c.workspace == workspace)
        with self._database.reading() as connection:
            rows = connection.execute(query.order_by(UPLOAD.c.created, UPLOAD.c.id))
            return [_upload(row) for row in rows]

    def advance(self, identity: str, begin: int, end: int) -> Upload:
        """Record that the bytes from `begin` to `end` have been written.

        Raises
        ------
        StoreError
            `UNKNOWN_UPLOAD`; `WRONG_OFFSET` if `begin` is not where the last part ended, `end` is
            beyond the size, or the upload is not open.
        """
        with self._database.writing() as connection:
            row = _row(connection, identity)
            if row.state != _OPEN:
                raise StoreError(StoreFault.WRONG_OFFSET, f"is {row.state}", f"upload {row.name!r}")
            if begin != row.offset or not begin <= end <= row.size:
                raise StoreError(
                    StoreFault.WRONG_OFFSET,
                    f"bytes {begin} to {end} do not follow: {row.offset} of {row.size} are there",
                    f"upload {row.name!r}",
                )
            return self._changed(connection, identity, offset=end)

    def end(self, identity: str, state: UploadState) -> Upload:
        """Record that an upload is complete or removed.

        Raises
        ------
        StoreError
            `UNKNOWN_UPLOAD`; `WRONG_OFFSET` if it is to be complete, and bytes are missing or it
            was removed.
        """
        with self._database.writing() as connection:
            row = _row(connection, identity)
            missing = row.offset != row.size or row.state == UploadState.REMOVED.value
            if state is UploadState.COMPLETE and missing:
                what = f"is not complete: {row.offset} of {row.size} bytes are there"
                raise StoreError(StoreFault.WRONG_OFFSET, what, f"upload {row.name!r}")
            return self._changed(connection, identity, state=state.value)

    def _changed(self, connection: Connection, identity: str, **values: Any) -> Upload:
        update = UPLOAD.update().where(UPLOAD.c.id == identity)
        connection.execute(update.values(changed=self._clock(), **values))
        return _upload(_row(connection, identity))


def _row(connection: Connection, identity: str) -> Row[Any]:
    row = connection.execute(select(UPLOAD).where(UPLOAD.c.id == identity)).first()
    if row is None:
        raise StoreError(StoreFault.UNKNOWN_UPLOAD, "there is no such upload", identity[:60])
    return row


def _upload(row: Row[Any]) -> Upload:
    values = dict(row._mapping)
    state = UploadState(values.pop("state"))
    return Upload(user=values.pop("owner"), state=state, **values)
