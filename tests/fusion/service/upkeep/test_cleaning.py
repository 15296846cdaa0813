"""Old things are removed, and nothing that anybody still works with; the settings that say when."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from command_line import called, refused

from fusion.service.api import Service
from fusion.service.jobs import JobKind, JobRequest
from fusion.service.store import Store, Upload
from fusion.service.store.records import UploadState
from fusion.service.upkeep import Ages, Cleaner, ServiceSettings, read_settings, settings_text
from spcola.errors import SettingsError

DAY = 86_400.0
AGES = Ages(10.0, 5.0, 20.0, uploads_days=3.0, outputs_days=6.0, logs_days=4.0)


class Clock:
    now = 2e9

    def __call__(self) -> float:
        return self.now

    def pass_days(self, days: float) -> None:
        self.now += days * DAY


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def service(clock: Clock, tmp_path: Path) -> Iterator[Service]:
    with Store(tmp_path / "store.sqlite", clock=clock) as store:
        yield Service(tmp_path, store)


def cleaner(service: Service, clock: Clock, ages: Ages = AGES) -> Cleaner:
    return Cleaner(service, service.root / "logs", ages, clock=clock)


def begun(service: Service, name: str, content: bytes = b"abc") -> Upload:
    new = Upload("", "ball", "ann", name, "scan", len(content), "0" * 64)
    made = service.store.uploads.add(new)
    (service.uploads / made.id).mkdir(parents=True)
    (service.uploads / made.id / "part").write_bytes(content)
    return made


def test_uploads_that_were_given_up_go(service: Service, clock: Clock) -> None:
    store = service.store
    given_up, needed, received, fresh = (begun(service, name) for name in "abcd")
    (service.uploads / "nobody's").mkdir()
    os.utime(service.uploads / "nobody's", (clock(), clock()))
    job = JobRequest(JobKind.IMPORT, "ball", "ann", {"uploads": [needed.id]})
    store.submit(job)
    clock.pass_days(4.0)
    store.uploads.advance(fresh.id, 0, 1)
    with service.receiving(received.id):
        assert cleaner(service, clock).clean()["uploads"] == 1
    kept = {needed.id, received.id, fresh.id}
    assert {upload.id for upload in store.uploads.kept("ball")} == kept
    assert {path.name for path in service.uploads.iterdir()} == kept
    assert store.uploads.get(given_up.id).state is UploadState.REMOVED
    assert store.audit.entries()[0].details["uploads"] == 1


def test_outputs_that_nobody_waits_for_go(service: Service, clock: Clock) -> None:
    ages = {
        "kernels": 9, "old.toml": 9, "needed.toml": 9, "new.toml": 5, ".lost": 9
    }  # fmt: skip
    folder = service.root / ".service" / "outputs" / "ball"
    for name, days in ages.items():
        path = folder / name / "a.tf" if "." not in name else folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        for one in (path, folder / name):
            os.utime(one, (clock() - days * DAY,) * 2)
    parameters = {"camera": {"output": "needed.toml"}, "uploads": ["x"]}
    job = service.store.submit(JobRequest(JobKind.IMAGES, "ball", "ann", parameters))
    (folder / f".{job.id}").mkdir()
    os.utime(folder / f".{job.id}", (clock() - 9 * DAY,) * 2)
    assert cleaner(service, clock).clean()["outputs"] == 3
    assert {path.name for path in folder.iterdir()} == {"needed.toml", "new.toml", f".{job.id}"}


def test_logs_of_ended_processes_go(service: Service, clock: Clock) -> None:
    logs = service.root / "logs"
    logs.mkdir()
    for name, days in {"old.jsonl": 5, "old.jsonl.1": 5, "new.jsonl": 3, "notes.txt": 9}.items():
        (logs / name).touch()
        os.utime(logs / name, (clock() - days * DAY,) * 2)
    assert cleaner(service, clock).clean()["logs"] == 2
    assert {path.name for path in logs.iterdir()} == {"new.jsonl", "notes.txt"}
    never = Ages(*[math.inf] * 6)
    clock.pass_days(10_000.0)
    assert not any(cleaner(service, clock, never).clean().values())


def test_settings_are_read_and_printed(tmp_path: Path) -> None:
    path = tmp_path / ".service" / "settings.toml"
    assert read_settings(path) == ServiceSettings()
    path.parent.mkdir()
    path.write_text("[keep]\njobs_days = 30\naudit_days = inf\n[parsers]\nmemory_mb = 4096\n")
    found = read_settings(path)
    assert found.keep == replace(Ages(), jobs_days=30, audit_days=math.inf)
    assert found.parsers.memory_mb == 4096
    path.write_text(settings_text(found))
    assert read_settings(path) == found
    assert called("serve", "settings", tmp_path)["settings"]["limits"] == asdict(found.limits)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[keep]\njob_days = 1", "[keep]: has the unknown entry 'job_days'"),
        ("[kept]", "has the unknown entry 'kept'"),
        ("keep = 1", "[keep]: should be a table"),
        ("[keep]\njobs_days = '1'", "[keep] jobs_days: should be a number, not '1'"),
        ("[keep]\njobs_days = -1", "[keep] jobs_days: should be positive"),
        ("[keep]\nlogs_days = 1", "[keep] logs_days: should be 2 or more"),
        ("[limits]\nuploads = inf", "[limits] uploads: should be a whole number"),
        ("[parsers]\nmemory_mb = 1", "2048 MB"),
        ("[keep", "is not TOML"),
    ],
)
def test_wrong_settings_are_refused_in_one_line(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / ".service" / "settings.toml"
    path.parent.mkdir()
    path.write_text(text)
    with pytest.raises(SettingsError) as caught:
        read_settings(path)
    assert says in str(caught.value)
    assert str(path) in refused("serve", tmp_path, "--port", 0)
