"""What the service is installed with: its unit, its image, its compose file; each command is run.

No engine for containers is needed: the recipes are read as their engines read them.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from command_line import ROOT
from server_process import ASKING_S, wait_for

DEPLOY = ROOT / "scripts" / "deploy"
NO_WORKERS = ("--workers", "0")
STATED = re.compile(r"\$\{(\w+)(?::\?[^}]*)?\}")


def unit() -> list[tuple[str, str]]:
    lines = (DEPLOY / "spcola.service").read_text().splitlines()
    pairs = [line.partition("=") for line in lines if "=" in line and not line.startswith("#")]
    return [(key, value) for key, _, value in pairs]


def variables(path: Path) -> dict[str, str]:
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return dict(line.split("=", 1) for line in lines)


def instructions(path: Path) -> list[tuple[str, str]]:
    """Return the instructions of a Dockerfile and what each is given."""
    kept = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(kept))
    return [(name, rest) for name, rest in (line.split(" ", 1) for line in joined.splitlines())]


@contextmanager
def running(command: list[str], **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a command meanwhile; then end it as an engine does, and check that it ends well."""
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
        process.terminate()
        assert process.wait(90) == 0, command
    finally:
        process.kill()
        process.wait()


def serving(options: list[str], folder: Path, port: int, *more: str) -> list[str]:
    """Return the command of a recipe with another folder and port, and more options."""
    place = next(index for index, word in enumerate(options) if word.startswith("/"))
    options = [*options[:place], str(folder), *options[place + 1 :]]
    options[options.index("--port") + 1] = str(port)
    return [sys.executable, "-m", "fusion.cli", "serve", *options, *more]


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def answers(url: str) -> bool:
    try:
        return httpx.get(f"{url}/health").status_code == 200
    except httpx.TransportError:
        return False


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_the_unit_is_sound_and_lets_nothing_else_be_reached(tmp_path: Path) -> None:
    path = tmp_path / "spcola.service"
    program = Path(sys.executable).with_name("spcola")
    path.write_text(
        (DEPLOY / path.name).read_text().replace("/opt/spcola/bin/spcola", str(program))
    )
    checked = subprocess.run(
        ["systemd-analyze", "verify", path], check=False, capture_output=True, text=True
    )
    assert (checked.returncode, checked.stderr) == (0, "")
    limit = ["--offline=true", "--threshold=20"]
    subprocess.run(["systemd-analyze", "security", *limit, path], check=True, capture_output=True)


def test_the_command_of_the_unit_serves_and_drains(tmp_path: Path) -> None:
    given = variables(DEPLOY / "service.env")
    (start,) = [value for key, value in unit() if key == "ExecStart"]
    words = [STATED.sub(lambda one: given[one[1]], word) for word in shlex.split(start)]
    assert words[:2] == ["/opt/spcola/bin/spcola", "serve"]
    folder, port = words[3], free_port()
    written = dict(unit())["ReadWritePaths"]
    assert folder == written
    with running(serving(words[2:], tmp_path, port, *NO_WORKERS), **given):
        wait_for(lambda: answers(f"http://127.0.0.1:{port}"), every=ASKING_S)
        url = f"http://127.0.0.1:{port}/api/v1/workspaces"
        assert httpx.get(url, headers={"Host": given["SPCOLA_NAME"]}).status_code == 401
        assert httpx.get(url, headers={"Host": "other.example.org"}).status_code == 421
    log = (tmp_path / ".service" / "logs" / "server.jsonl").read_text().splitlines()
    assert json.loads(log[-1])["event"] == "drained"


def test_the_image_recipe() -> None:
    found = instructions(DEPLOY / "Dockerfile")
    stages = [re.fullmatch(r"(\S+) AS (\w+)", rest) for name, rest in found if name == "FROM"]
    assert [stage[2] for stage in stages] == ["build", "service"]
    assert all(":" in stage[1] and not stage[1].endswith(":latest") for stage in stages)
    assert {name for name, _ in found} <= {
        "FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "VOLUME", "EXPOSE", "STOPSIGNAL",
        "HEALTHCHECK", "ENTRYPOINT", "CMD",
    }  # fmt: skip
    for name, rest in found:
        if name == "RUN":
            subprocess.run(["bash", "-n", "-c", rest], check=True)
            if "apt-get install" in rest:
                assert "rm -rf /var/lib/apt/lists" in rest
    last = dict(found[[name for name, _ in found].index("FROM", 1) :])
    assert int(last["USER"]) > 0
    # What is needed to build a wheel gets into the build.
    kept = (DEPLOY / "Dockerfile.dockerignore").read_text().split("\n")
    assert {"!pyproject.toml", "!constraints.txt", "!spcola", "!lidar", "!fusion"} <= set(kept)
    libraries = re.search(
        r"SYSTEM_LIBRARIES=\((.*?)\)", (ROOT / "scripts/lib/environment.sh").read_text()
    )
    installed = next(rest for name, rest in found if "apt-get install" in rest)
    assert set(libraries[1].split()) <= set(installed.split())


def test_the_command_and_the_health_check_of_the_image(tmp_path: Path) -> None:
    last = dict(instructions(DEPLOY / "Dockerfile"))
    assert json.loads(last["ENTRYPOINT"]) == ["spcola", "serve"]
    check = json.loads(last["HEALTHCHECK"].partition(" CMD ")[2])
    assert check[0] == "python"
    port = free_port()
    check = [sys.executable, check[1], check[2].replace(":8080/", f":{port}/")]
    assert subprocess.run(check, check=False, stderr=subprocess.DEVNULL).returncode
    with running(serving(json.loads(last["CMD"]), tmp_path, port, *NO_WORKERS)):
        wait_for(lambda: answers(f"http://127.0.0.1:{port}"), every=ASKING_S)
        subprocess.run(check, check=True)


def compose() -> dict[str, Any]:
    return yaml.safe_load((DEPLOY / "compose.yaml").read_text())


def test_the_compose_file() -> None:
    found = compose()
    services = found["services"]
    assert set(services) == {"store", "scheduler", "worker", "server"}
    text = (DEPLOY / "compose.yaml").read_text()
    assert {one[1] for one in STATED.finditer(text)} == {"SPCOLA_NAME", "SPCOLA_STORE_PASSWORD"}
    for name, service in services.items():
        assert set(service["networks"]) <= set(found["networks"])
        for volume in service["volumes"]:
            place = volume.partition(":")[0]
            assert place in found["volumes"] or place == "./certificates.d"
        assert set(service.get("depends_on", ())) <= set(services)
        if name != "store":
            assert service["read_only"]
            assert service["cap_drop"] == ["ALL"]
    # Only the server is reached from outside, and only by a proxy on its host.
    assert [name for name, service in services.items() if "ports" in service] == ["server"]
    assert services["server"]["ports"][0].startswith("127.0.0.1:")
    assert not [name for name in ("store", "cluster") if not found["networks"][name]["internal"]]
    built = services["server"]["build"]
    assert (DEPLOY / built["context"] / built["dockerfile"]).samefile(DEPLOY / "Dockerfile")
    assert services["scheduler"]["image"] == services["server"]["image"]


@pytest.mark.slow
def test_a_job_on_the_cluster_of_the_compose_file(ball: Path, tmp_path: Path) -> None:
    made = tmp_path / "certificates"
    subprocess.run([DEPLOY / "certificates", made], check=True, stdout=subprocess.DEVNULL)
    services = compose()["services"]
    given = {
        name: value.replace("/certificates", str(made))
        for name, value in services["server"]["environment"].items()
        if name.startswith("DASK_")
    }
    port, folder = free_port(), tmp_path / "data"
    shutil.copytree(ball, folder / "ball")
    scheduler = f"tls://127.0.0.1:{port}"

    def words(name: str) -> list[str]:
        service = services[name]
        both = [*service.get("entrypoint", ()), *service["command"]]
        known = {"SPCOLA_NAME": "spc.example.org"}
        both = [STATED.sub(lambda one: known[one[1]], word) for word in both]
        return [word.replace("tls://scheduler:8786", scheduler) for word in both]

    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    command = [str(port) if word == "8786" else word for word in words("scheduler")[2:]]
    at_home = ["--host", "127.0.0.1"]
    place = free_port()
    with (
        running([*dask, *command, *at_home], **given),
        running(
            [sys.executable, "-m", "distributed.cli.dask_worker", *words("worker")[2:], *at_home],
            **given,
        ),
        running(serving(words("server"), folder, place), **given),
    ):
        wait_for(lambda: answers(f"http://127.0.0.1:{place}"), every=ASKING_S)
        token = subprocess.run(
            [sys.executable, "-m", "fusion.cli", "serve", "token", "add", folder, "ann",
             "--scope", "run"],
            check=True, capture_output=True, text=True, cwd=ROOT,
        ).stdout.strip()  # fmt: skip
        headers = {"Host": "spc.example.org", "Authorization": f"Bearer {token}"}
        with httpx.Client(
            base_url=f"http://127.0.0.1:{place}/api/v1", headers=headers, timeout=60
        ) as client:
            run = {"kind": "run", "parameters": {"stages": ["mapolas"]}}
            job = client.post("/workspaces/ball/jobs", json=run).json()["id"]
            wait_for(
                lambda: client.get(f"/jobs/{job}").json()["state"] == "finished",
                120,
                every=ASKING_S,
            )
