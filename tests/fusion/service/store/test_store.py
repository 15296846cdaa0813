"""Tokens, audit log, uploads; stores that are saved, restored, upgraded and repaired."""

from __future__ import annotations

import json
import sqlite3
import stat
from contextlib import closing
from pathlib import Path

import psycopg
import pytest
from command_line import called
from sqlalchemy import inspect, text

from fusion.pipeline.catalog.records import StageRecord
from fusion.service.jobs import JobKind, JobRequest, JobState
from fusion.service.store import AuditEntry, Scope, Store, StoreError, Upload, schema
from fusion.service.store.records import UploadState
from fusion.service.store.recovery import record_recovered_runs
from fusion.workspace import new_workspace
from spcola.errors import InvalidValueError

REQUEST = JobRequest(JobKind.RUN, "bennu", "ada", {"stages": ["register"]})
VERSION_1 = Path(__file__).with_name("version_1.sql")
SECRET_1 = "spcola_eeinXR151_5btqXbzsz_mcc7fDA-woLsvDC3YnQJp1E"  # of the token in that file


def fault(call) -> tuple[str, str]:
    with pytest.raises(StoreError) as caught:
        call()
    assert "\n" not in str(caught.value)
    return caught.value.code, str(caught.value)


def test_tokens(new_url) -> None:
    clock = 1e9
    with Store(new_url(), clock=lambda: clock) as store:
        scopes = {"bennu": Scope.RUN, "*": Scope.READ}
        secret, token = store.tokens.make("ada", scopes, name="notebook", lifetime_s=3600.0)
        assert store.tokens.check(secret).id == token.id
        assert store.tokens.all()[0].last_used == clock
        assert token.permits(Scope.RUN, "bennu")
        assert not token.permits(Scope.ADMIN, "bennu")
        assert token.permits(Scope.READ, "eros")
        assert not token.permits(Scope.RUN, "eros")
        assert not token.permits(Scope.RUN)
        # The store does not contain what would open it.
        with store._database.reading() as connection:
            rows = str(connection.execute(text("SELECT * FROM token")).all())
        assert secret not in rows
        assert secret.removeprefix("spcola_") not in rows
        for wrong in ("", "spcola_", secret[:-1], secret + "x", "\udcff"):
            assert fault(lambda wrong=wrong: store.tokens.check(wrong))[0] == "refused-token"
        clock += 3601.0
        assert fault(lambda: store.tokens.check(secret))[0] == "refused-token"
        # An expired token does not come back with a clock that is set back.
        clock -= 3000.0
        assert fault(lambda: store.tokens.check(secret))[0] == "refused-token"
        other, token = store.tokens.make("bea", {"*": Scope.ADMIN})
        store.tokens.revoke(token.id)
        assert fault(lambda: store.tokens.check(other))[0] == "refused-token"
        assert fault(lambda: store.tokens.revoke("x"))[0] == "unknown-token"
        with pytest.raises(InvalidValueError):
            store.tokens.make("ada", {})


def test_audit_log_and_uploads(store: Store) -> None:
    for n in range(5):
        store.audit.add(AuditEntry("ada", "submit", f"w{n % 2}", f"job {n}", details={"n": n}))
    first = store.audit.entries(limit=2)
    assert [one.details["n"] for one in first] == [4, 3]
    rest = store.audit.entries(before=first[-1].number, workspace="w0")
    assert [one.target for one in rest] == ["job 2", "job 0"]

    new = store.uploads.add(Upload("", "w0", "ada", "a.laz", "scan", 10, "ab" * 32))
    assert store.uploads.kept("w0") == [new]
    assert store.uploads.advance(new.id, 0, 6).offset == 6
    for begin, end in ((0, 6), (5, 10), (6, 11), (6, 5)):
        call = lambda begin=begin, end=end: store.uploads.advance(new.id, begin, end)  # noqa: E731
        assert fault(call)[0] == "wrong-offset"
    assert fault(lambda: store.uploads.end(new.id, UploadState.COMPLETE))[0] == "wrong-offset"
    store.uploads.advance(new.id, 6, 10)
    assert store.uploads.kept("w0")[0].offset == 10
    assert store.uploads.end(new.id, UploadState.COMPLETE) == store.uploads.get(new.id)
    assert store.uploads.kept("w0") != []
    assert fault(lambda: store.uploads.advance(new.id, 10, 10))[0] == "wrong-offset"
    assert fault(lambda: store.uploads.get("x"))[0] == "unknown-upload"


def test_a_backup_restores_into_either_kind_of_store(store: Store, folder: Path) -> None:
    job = store.submit(REQUEST)
    store.claim("w", 60.0)
    kept, _ = store.tokens.make("ada", {"*": Scope.READ})
    revoked, token = store.tokens.make("bea", {"*": Scope.ADMIN})
    store.audit.add(AuditEntry("ada", "submit"))
    backup = folder / "backup.sqlite"
    store.backup(backup)
    assert stat.S_IMODE(backup.stat().st_mode) == 0o600
    assert fault(lambda: store.backup(backup))[1].endswith("give another name")
    saved = store.jobs(), store.events()

    store.finish(job.id, "w", {})
    store.tokens.revoke(token.id)
    later = store.submit(REQUEST)
    last = store.events()[-1].number
    store.restore(backup)
    assert (store.jobs(), store.events()) == saved
    assert store.tokens.check(kept).user == "ada"
    assert fault(lambda: store.tokens.check(revoked))[0] == "refused-token"
    assert store.submit(REQUEST).id != later.id
    assert store.events()[-1].number > last
    with Store(folder / "other.sqlite") as other:
        other.restore(backup)
        assert (other.jobs(), other.events()) == saved


def test_what_is_no_backup_changes_nothing(store: Store, folder: Path) -> None:
    store.submit(REQUEST)
    before = store.jobs()
    (folder / "text").write_text("This is no data base. " * 100)
    with closing(sqlite3.connect(folder / "foreign")) as foreign:
        foreign.executescript("CREATE TABLE picture (x)")
    store.backup(folder / "newer")
    with closing(sqlite3.connect(folder / "newer")) as newer:
        newer.executescript("UPDATE setting SET value = '99'")
    for name, code in {
        "text": "damaged-store",
        "foreign": "damaged-store",
        "absent": "store-unavailable",
        "newer": "newer-store",
    }.items():
        assert fault(lambda name=name: store.restore(folder / name))[0] == code
    assert store.jobs() == before


def version_1(path: Path) -> Path:
    with closing(sqlite3.connect(path)) as file:
        file.executescript(VERSION_1.read_text())
    return path


def check_version_1(store: Store) -> None:
    states = [job.state for job in store.jobs()]
    assert states == [JobState.FAILED, JobState.WAITING, JobState.FINISHED]
    assert store.jobs()[0].error.item == "BE0001"
    assert store.jobs()[1].request.priority == 5
    assert store.jobs()[2].result == {"ingest": {"scans": 2}}
    assert len(store.events()) == 9
    assert store.tokens.check(SECRET_1).permits(Scope.RUN, "bennu")
    assert store.audit.entries()[-1].details == {"n": 1}
    assert store.uploads.kept("bennu")[0].size == 10
    job = store.claim("w", 60.0)
    assert job.request.parameters["solution"] == "a"


def test_a_store_of_the_first_version_is_read(store: Store, folder: Path) -> None:
    with Store(version_1(folder / "old.sqlite")) as old:
        assert old.notes == []
        check_version_1(old)
    store.restore(version_1(folder / "old_backup.sqlite"))
    check_version_1(store)


def test_a_first_version_on_a_server_is_read(new_database, folder: Path) -> None:
    url = new_database()
    with psycopg.connect(url) as server:
        server.execute(VERSION_1.with_suffix(".postgresql.sql").read_bytes())
    (listed,) = called("serve", "token", "list", folder, "--store", url)["tokens"]
    assert listed["scopes"]
    with Store(url) as old:
        check_version_1(old)


def test_an_older_store_is_upgraded_after_a_backup(new_url, folder: Path, monkeypatch) -> None:
    # The step is the test's; what runs it is the program's.
    def add_column(connection) -> None:
        connection.execute(text("ALTER TABLE job ADD COLUMN color TEXT NOT NULL DEFAULT ''"))

    def fail_late(connection) -> None:
        add_column(connection)
        raise KeyboardInterrupt

    url = new_url()
    with Store(url) as store:
        store.restore(version_1(folder / "old.sqlite"))
    for module in ("schema", "backup", "opening"):
        monkeypatch.setattr(f"fusion.service.store.{module}.VERSION", 3)
    monkeypatch.setattr(schema, "UPGRADES", {**schema.UPGRADES, 2: fail_late})
    backups = folder / "backups"
    backups.mkdir()
    with pytest.raises(KeyboardInterrupt):
        Store(url, backups=backups)
    monkeypatch.setattr(schema, "UPGRADES", {**schema.UPGRADES, 2: add_column})
    with Store(url, backups=backups) as store:
        with store._database.reading() as connection:
            assert "color" in [one["name"] for one in inspect(connection).get_columns("job")]
            assert schema.stored_version(connection) == 3
        check_version_1(store)
    monkeypatch.undo()
    assert fault(lambda: Store(url))[0] == "newer-store"
    saved = sorted(backups.iterdir())
    assert saved
    with Store(folder / "restored.sqlite") as store:
        store.restore(saved[-1])
        check_version_1(store)


DAMAGES = {
    "overwritten": lambda content: content[:4096] + b"\x5a" * 8192 + content[12288:],
    "cut": lambda content: content[: len(content) // 2],
    "empty": lambda _: b"",
    "no data base": lambda _: b"What is this? " * 500,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_store_is_kept_aside(damage, folder: Path) -> None:
    path = folder / "store.sqlite"
    with Store(path) as store:
        for _ in range(30):
            store.submit(REQUEST)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    content = DAMAGES[damage](path.read_bytes())
    path.write_bytes(content)
    with Store(path) as repaired:
        assert len(repaired.notes) == 1
        assert "was damaged" in repaired.notes[0]
        aside = next(folder.glob("store.sqlite.damaged-*"))
        assert aside.name in repaired.notes[0]
        assert aside.read_bytes() == content
        assert repaired.audit.entries()[0].action == "store-rebuilt"
        assert repaired.jobs() == []
        repaired.submit(REQUEST)
        with Store(path) as again:
            assert again.notes == []


def test_a_store_that_was_replaced_is_not_written_to(folder: Path) -> None:
    path = folder / "store.sqlite"
    with Store(path) as worker:
        worker.submit(REQUEST)
        path.write_bytes(b"x" * 5000)
        with Store(path) as server:
            worker.submit(REQUEST)
            assert len(server.jobs()) == len(worker.jobs()) == 1


def test_files_of_other_programs_are_left_alone(folder: Path) -> None:
    path = folder / "pictures.sqlite"
    with closing(sqlite3.connect(path)) as foreign:
        foreign.executescript("CREATE TABLE picture (x)")
    assert "of another program" in fault(lambda: Store(path))[1]
    with closing(sqlite3.connect(path)) as foreign:
        assert foreign.execute("SELECT name FROM sqlite_master").fetchall() == [("picture",)]
    with pytest.raises(InvalidValueError, match=r"mysql://u:\*\*\*@h/d: the store cannot be"):
        Store("mysql://u:secret@h/d")


def test_a_full_disk_refuses_and_leaves_what_was_there(folder: Path) -> None:
    with Store(folder / "store.sqlite") as store:
        store.submit(REQUEST)
        # What SQLite does when the disk is full, without filling one.
        with store._database.reading() as connection:
            connection.exec_driver_sql("PRAGMA max_page_count = 1")
        big = JobRequest(JobKind.RUN, "bennu", "ada", {"only": ["x" * 50_000]})
        assert fault(lambda: store.submit(big))[0] == "disk-full"
        assert len(store.jobs()) == 1


def test_an_unreachable_server_is_named_without_its_password() -> None:
    url = "postgresql://ada:secret@127.0.0.1:1/none"
    code, message = fault(lambda: Store(url))
    assert code == "store-unavailable"
    assert "secret" not in message
    assert "127.0.0.1" in message


def test_connections_that_the_server_ends_are_made_anew(new_database) -> None:
    def end_all(connection) -> None:
        others = "WHERE datname = current_database() AND pid <> pg_backend_pid()"
        connection.execute(text(f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity {others}"))

    url = new_database()
    with Store(url) as store, Store(url) as other:
        store.submit(REQUEST)

        def submit_while_the_server_stops() -> None:
            with store._database.writing() as connection:
                connection.execute(text("DELETE FROM job"))
                with other._database.reading() as administrator:
                    end_all(administrator)
                connection.execute(text("DELETE FROM event"))

        assert fault(submit_while_the_server_stops)[0] == "store-unavailable"
        assert len(store.jobs()) == len(store.events()) == 1
        with other._database.reading() as administrator:
            end_all(administrator)
        assert store.submit(REQUEST).state is JobState.WAITING


def test_finished_runs_are_recovered_from_the_workspaces(store: Store, tmp_path: Path) -> None:
    roots = {"bennu": tmp_path / "a", "new": tmp_path / "b", "absent": tmp_path / "c"}
    for root in (roots["bennu"], roots["new"]):
        new_workspace(root, body="Bennu")
    (roots["bennu"] / "provenance").mkdir()
    for stage, time in {"ingest": "2026-11-20T10:00:00", "register": "2026-11-21T10:00:00"}.items():
        record = StageRecord(stage, "k", "1", {}, {}, {}, {"n": 3}, f"{time}+00:00")
        path = roots["bennu"] / "provenance" / f"{stage}.json"
        path.write_text(json.dumps(record.as_dict()))
    lines = record_recovered_runs(store, roots)
    assert [line.partition(" ")[0] for line in lines] == ["bennu,", "absent:"]
    (job,) = store.jobs()
    assert job.state is JobState.FINISHED
    assert job.request.user == "recovered"
    assert job.result == {"ingest": {"n": 3}, "register": {"n": 3}}
    assert job.ended == 1795255200.0
    assert store.audit.entries()[0].action == "run-recovered"
    record_recovered_runs(store, roots)
    assert len(store.jobs()) == 1


def test_jobs_that_only_read_go_along_with_others(store: Store) -> None:
    for kind in (JobKind.RUN, JobKind.RUN, JobKind.LOOK, JobKind.INFO):
        store.submit(JobRequest(kind, "bennu", "ada"))
    claimed = [store.claim(f"w{number}", 60.0) for number in range(4)]
    assert [one and one.request.kind for one in claimed] == [
        JobKind.RUN, JobKind.LOOK, JobKind.INFO, None,
    ]  # fmt: skip
