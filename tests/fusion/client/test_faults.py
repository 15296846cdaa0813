"""Connections that break, servers that start again, tokens and names that are wrong."""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from command_line import call, called, refused
from served import MAPLETS, make_ball
from server_process import ServerProcess

import spcola
from fusion.client import (
    JobFailedError,
    Session,
    UnreachableError,
    VersionWarning,
    connect,
    fetching,
    sending,
)
from fusion.client.steps import Send, run
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.jobs import JobState
from fusion.service.store import StoreError, UnknownJobError
from fusion.workspace import Workspace
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.shapes import write_icq
from spcola.shape.icq import IcqShape, icq_directions

CONTENT = bytes(range(256)) * 400


@pytest.fixture
def own(tmp_path: Path) -> Iterator[ServerProcess]:
    """A server that a test may kill."""
    make_ball(tmp_path / "ball")
    started = ServerProcess(tmp_path)
    yield started
    started.kill()


def test_a_wait_and_an_upload_go_on_when_the_server_starts_again(
    own: ServerProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sending, "_PART", 10_000)
    source = tmp_path / "a.las"
    source.write_bytes(CONTENT)
    sent: list[int] = []

    class InterruptedHereError(Exception):
        pass

    with connect(own.url) as session:
        perform = type(session.doing()).perform

        def until_the_third(self, effect):
            if isinstance(effect, Send) and effect.request.method == "PATCH":
                sent.append(int(effect.request.headers["Upload-Offset"]))
                if len(sent) == 3:
                    raise InterruptedHereError
            return perform(self, effect)

        monkeypatch.setattr(type(session.doing()), "perform", until_the_third)
        with pytest.raises(InterruptedHereError):
            session.upload("ball", source, progress=False)
        job = session.submit("ball", ["mapolas"])
        threading.Timer(0.3, lambda: (own.kill(), time.sleep(0.5), own.start())).start()
        done = session.wait(job, progress=False)
        assert done.state is JobState.FINISHED
        assert done.result["stages"][0]["stage"] == "mapolas"
        # Events after the new start go on after the last one.
        first = next(iter(session.events(job)))
        states = [e.content.get("state") for e in session.events(job, after=first.number)]
        assert "waiting" not in states
        assert states[-1] == "finished"
    with connect(own.url) as session:
        upload = session.upload("ball", source, progress=False)
        assert sent == list(range(0, 20_001, 10_000)) + list(range(20_000, len(CONTENT), 10_000))
        (record,) = session.uploads("ball")
        assert (record["state"], record["sha256"]) == (
            "complete", hashlib.sha256(CONTENT).hexdigest(),
        )  # fmt: skip
        # The same file again is there already.
        assert session.upload("ball", source, progress=False) == upload
        assert len(sent) == 3 + len(CONTENT) // 10_000 - 1


def test_a_download_goes_on_and_a_changed_file_begins_anew(
    remote: Session, local: Session, missions: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fetching, "_PART", 1000)
    source = missions / "ball" / "NOMINALS" / "A.BIN"
    source.write_bytes(CONTENT)
    for number, session in enumerate((remote, local)):
        folder = tmp_path / str(number)
        folder.mkdir()
        part = session.place.file("ball", "files/NOMINALS/A.BIN", 0, 1000, "")
        got = run(part, session.doing())
        (folder / f".A.BIN.{got.tag.encode().hex()}.part").write_bytes(b"x" * 500)
        found = session.download("ball", "NOMINALS/A.BIN", folder, progress=False)
        # The bytes that were there are not asked for again.
        assert found.read_bytes() == b"x" * 500 + CONTENT[500:]
        (folder / f".A.BIN.{b'other'.hex()}.part").write_bytes(b"y" * 500)
        assert session.download("ball", "NOMINALS/A.BIN", folder, progress=False) == found
        assert found.read_bytes() == CONTENT
        assert [path.name for path in folder.iterdir()] == ["A.BIN"]
        (output,) = session.download_output("ball", "kernels", folder / "new", progress=False)
        assert (output, output.read_bytes()) == (folder / "new" / "a.bc", b"kernel")
        with pytest.raises(RequestRefusedError, match="no such file"):
            session.download("ball", ".items/A.BIN", folder, progress=False)


def test_a_request_that_got_no_answer_makes_one_job(
    remote: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    send, lost = httpx.Client.request, []

    def without_answer(self, method, **given):
        answer = send(self, method, **given)
        if method == "POST" and not lost:
            lost.append(answer.json()["id"])
            raise httpx.ReadError("the connection broke")
        return answer

    monkeypatch.setattr(httpx.Client, "request", without_answer)
    before = len(remote.jobs("ball"))
    job = remote.submit("ball", ["mapolas"])
    assert job.id == lost[0]
    assert len(remote.jobs("ball")) == before + 1
    remote.wait(job, progress=False)


def test_errors_of_a_server_are_those_of_the_command(
    remote: Session, local: Session, tmp_path: Path
) -> None:
    damaged = tmp_path / "a.las"
    damaged.write_bytes(b"LASF" + bytes(100))
    for session in (remote, local):
        with pytest.raises(UnknownJobError):
            session.job("nothing")
        with pytest.raises(RequestRefusedError) as missing:
            session.overview("nothing")
        assert missing.value.code is Refusal.NOT_FOUND
        with pytest.raises(InvalidValueError, match="nothing"):
            session.submit("ball", ["mapolas"], nothing=1)
        with pytest.raises(InvalidValueError, match="there is no stage"):
            session.submit("ball", ["nothing"])
        job = session.import_scans("ball", [damaged], progress=False)
        with pytest.raises(FormatError, match=r"a\.las"):
            session.wait(job, progress=False)
        first = session.submit("ball", ["mapolas"], force=True)
        second = session.submit("ball", ["mapolas"], force=True, after=[first])
        assert session.cancel(second).state is JobState.CANCELLED
        with pytest.raises(JobFailedError, match="was cancelled"):
            session.wait(second, progress=False)
        with pytest.raises(TimeoutError, match="it goes on"):
            session.wait(first, progress=False, timeout_s=0.0)
        assert session.wait(first, progress=False).state is JobState.FINISHED


def test_tokens_versions_and_addresses_that_are_wrong(
    tmp_path: Path,
    server: ServerProcess,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    make_ball(tmp_path / "ball")
    closed = ServerProcess(tmp_path, "--name", "localhost", "--workers", "0")
    try:
        with pytest.raises(RequestRefusedError, match="token is needed"):
            connect(closed.url)
        with pytest.raises(StoreError):
            connect(closed.url, "wrong")
        secret = called("serve", "token", "add", tmp_path, "ann", "--scope", "read")["secret"]
        monkeypatch.setenv("SPCOLA_TOKEN", secret)
        with connect(closed.url) as session:
            assert session.workspaces() == ["ball"]
            with pytest.raises(RequestRefusedError) as forbidden:
                session.submit("ball")
            assert forbidden.value.code is Refusal.FORBIDDEN
    finally:
        closed.kill()
    begun = time.monotonic()
    with pytest.raises(UnreachableError, match="does not answer"):
        connect(closed.url, patience_s=2.0)
    assert time.monotonic() - begun < 10
    # The reason for the wait is logged once.
    (noticed,) = (one.getMessage() for one in caplog.records if one.name == "spcola.client")
    assert noticed.startswith(f"{closed.url.rstrip('/')}: does not answer")
    assert noticed.endswith("trying for up to 2 s")
    with pytest.raises(WorkspaceError):
        connect(tmp_path / "nothing")
    monkeypatch.delenv("SPCOLA_TOKEN")
    monkeypatch.setattr(spcola, "__version__", "9.9.9")
    with pytest.warns(VersionWarning, match=r"this client 9\.9\.9"):
        connect(server.url).close()


def _check_pictures(there: tuple[str, str], missions: Path, folder: Path) -> None:
    """A picture has the same bytes wherever it is made, and nothing is left on the server."""
    maplet = "ball/MAPFILES/AA0001.MAP"
    for name, command in {
        "maplet.png": ("look", maplet),
        "difference.png": ("solution", "diff", "ball", "imported", "imported"),
    }.items():
        found = []
        for where in (there, ()):
            printed = called(*where, *command, "-o", folder / name)
            found.append((printed, (folder / name).read_bytes()))
            (folder / name).unlink()
        assert found[0] == found[1]
    assert [path.name for path in (missions / ".service/outputs/ball").iterdir()] == ["kernels"]
    assert called(*there, "info", maplet) == called("info", maplet)
    for wrong, text in {
        "ball/.service": "is no name of a file",
        "ball/spcola.toml": "there is nothing to draw",
    }.items():
        assert text in refused(*there, "look", wrong, "-o", folder / "wrong.png")
    assert "is no name of a picture" in refused(*there, "look", "ball", "-o", folder / "a.gif")
    assert not list(folder.iterdir())


def test_a_refused_result_and_warnings_are_printed_as_here(
    server: ServerProcess, missions: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(missions)
    there = ("--server", server.url)
    call(*there, "mapolas", "ball")
    settings = missions / "ball" / "spcola.toml"
    text = settings.read_text()
    changed = text.replace("min_count = 1 ", "min_count = 2 ")
    assert changed != text
    settings.write_text(changed)
    one, two = (call(*where, "register", "ball", code=1) for where in (there, ()))
    settings.write_text(text)
    printed = [sorted(result.stdout.splitlines()) for result in (one, two)]
    assert [line for line in printed[0] if not line.startswith("register: ")] == [
        line for line in printed[1] if not line.startswith("register: ")
    ]
    assert "  verdict: refused" in printed[0]
    for result in (one, two):
        assert "note: mapolas is out of date; spcola run brings all up to date\n" in result.stderr
    last = [result.stderr.splitlines()[-1] for result in (one, two)]
    assert last[0] == last[1]
    assert last[0].startswith("error: ball: the result of register is refused")
    # Without images there is nothing to solve maplets from.
    fuse = ("fuse", "ball", "--from", "images")
    last = [call(*where, *fuse, code=1).stderr.splitlines()[-1] for where in (there, ())]
    assert last[0] == last[1]
    assert "bring images" in last[0]
    wrong = [call(*where, "fuse", "ball", "--as", "x", code=2).stderr for where in (there, ())]
    assert wrong[0] == wrong[1]
    # Wrong usage is that of the command here, too.
    for option in (("--model", "none"), ("--accept", "none")):
        codes = [call(*where, "register", "ball", *option, code=2).stderr for where in (there, ())]
        assert codes[0] == codes[1]


def test_commands_on_a_server(
    server: ServerProcess, missions: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(missions)
    there = ("--server", server.url)
    compared = ["solution", "diff", "ball", "imported", "imported"]
    for command in (["solution", "list", "ball"], compared, ["mapolas", "ball", "--force"]):
        one, two = called(*there, *command), called(*command)
        for found in (one, two):
            found.pop("seconds", None)
        assert one == two
        if "mapolas" not in command:
            printed = [call(*where, *command).stdout for where in (there, ())]
            assert printed[0] == printed[1]
    info = called(*there, "info", "ball")
    assert info.keys() == called("info", "ball").keys()
    assert "local files" in refused(*there, "align", "a.las", "b.las")
    _check_pictures(there, missions, tmp_path)
    assert "--workers" in refused(*there, "mapolas", "ball", "--workers", 2)
    assert "no such workspace" in refused(*there, "run", "nothing")
    exported = tmp_path / "exported"
    called(*there, "solution", "export", "ball", "imported", exported)
    assert len(list((exported / "MAPFILES").iterdir())) == MAPLETS
    # Shape and body constants of an SPC folder travel with its maplets.
    for name in ("SHAPEFILES", "NOMINALS"):
        (exported / name).mkdir(exist_ok=True)
    write_icq(exported / "SHAPEFILES" / "SHAPE.TXT", IcqShape(60.0 * icq_directions(8)))
    (exported / "NOMINALS" / "A.BIN").write_bytes(b"no SPC file")
    assert "A.BIN: is not the name of an SPC file" in refused(
        *there, "init", "away", "--spc", exported
    )
    (exported / "NOMINALS" / "A.BIN").unlink()
    here = called("init", "here", "--spc", exported)
    away = called(*there, "init", "away", "--spc", exported)
    assert away["shape"] == here["shape"] != ""
    assert away["maplets"] == MAPLETS
    body = [Workspace.open(missions / name).settings().body for name in ("here", "away")]
    assert body[1] == body[0].model_copy(update={"shape": "SHAPE.TXT"})
    listed = called(*there, "job", "list", "ball")["jobs"]
    (forecast,) = [one for one in listed if one["kind"] == "forecast"]
    assert called(*there, "job", "wait", "ball", forecast["id"])["state"] == "finished"
    scan = tmp_path / "new.txt"
    scan.write_text("x y z\n" + "".join(f"60.1 {k}.0 0.5\n" for k in range(-9, 9)))
    columns = ("--columns", "x=x [m],y=y [m],z=z [m]")
    made = called(*there, "import", "ball", scan, *columns)["scans"]
    assert (made[0]["scan"], made[0]["file"]) == ("new", scan.name)
