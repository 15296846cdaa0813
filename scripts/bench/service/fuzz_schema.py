"""Inputs of the described kinds for every operation of the interface: none may give a 5xx.

    python -m scripts.bench.service.fuzz_schema [--examples 100] [--seed 0] [--workspace DIR]

A real server process is asked over HTTP by schemathesis, with tokens of every scope; streams of
events are left out. In nine of ten inputs what the path names is there: the workspace is a run
mission (`--workspace` copies one), and an upload, a job, a token or an output that an operation may
end is made for it. One in ten has a token whose scope does not suffice, and is to be refused.
`reached` are inputs that got past names, scopes and the check of their kinds: answers other than
401, 403, 404, 405, 415 and the problem `invalid-request`; at least 80 % should. An upload for which
the disk has no room rightly gets 507; any other 5xx is wrong.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import shutil
import sys
import tempfile
import time
from collections import Counter, defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded

BENCH = Path(__file__).parents[1]
sys.path[:0] = [str(BENCH), str(BENCH.parents[1] / "tests" / "helpers")]
from kills import run  # noqa: E402
from routes_walk import BASE, QUERIES, names_there  # noqa: E402
from server_process import ServerProcess  # noqa: E402

from fusion.service.api.errors import Refusal  # noqa: E402
from fusion.service.state import outputs_folder  # noqa: E402
from fusion.service.store import Scope  # noqa: E402
from fusion.service.work.parameters import EXAMPLES  # noqa: E402

NAME = "truth"
HERE = BASE.replace("{workspace}", NAME)
SCOPES = [scope.value for scope in Scope]
UNREACHED = {401, 403, 404, 405, 415}
CONTENT = b"no scan at all"
NAMING = {"after", "before", "solution", "workspace", "job", "other"}
"""Parameters of queries that name what may not be there."""
KNOWN = {"method", "url", "headers", "params", "json", "content"}


@dataclass
class Tally:
    """What was answered."""

    answers: Counter[int] = field(default_factory=Counter)
    unreached: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    asked: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    full: int = 0

    def add(self, case: schemathesis.Case, answer: httpx.Response, *, refused: bool) -> None:
        """Count an answer; `refused` is what it should be."""
        name, status = f"{case.method} {case.path}", answer.status_code
        self.answers[status] += 1
        self.asked[name] += 1
        code = ""
        if status >= 400:
            with suppress(ValueError):
                code = answer.json()["code"]
        if status in UNREACHED or code == Refusal.INVALID:
            self.unreached[name][f"{status} {code}"] += 1
        if status == 507 and code == Refusal.DISK_FULL and "/uploads" in case.path:
            self.full += 1
        elif status >= 500 or (refused and status not in UNREACHED):
            self.wrong.append(f"{name}: {status} {answer.text[:200]}")


class Asked:
    """Completes inputs by names that are there, and by tokens."""

    def __init__(self, admin: httpx.Client, root: Path) -> None:
        self.admin, self.root = admin, root
        self.there = names_there(admin, HERE)
        self.tokens = {scope: self._token({"*": scope}) for scope in SCOPES}
        self.count = 0

    def _token(self, scopes: dict[str, str]) -> str:
        made = self.admin.post("/api/v1/tokens", json={"user": "ann", "scopes": scopes})
        return str(made.raise_for_status().json()["secret"])

    def _fresh(self, parameter: str, path: str) -> str:
        """Make what an operation may end; return its id."""
        self.count += 1
        if parameter == "upload":
            whole = path.endswith("complete")
            return self._upload(sent=CONTENT if whole else b"")
        if parameter == "job":
            made = self.admin.post(f"{HERE}/forecast", json={"parameters": {}})
            return str(made.raise_for_status().json()["id"])
        if parameter == "token":
            body = {"user": "eve", "scopes": {NAME: "read"}}
            return str(self.admin.post("/api/v1/tokens", json=body).json()["id"])
        place = outputs_folder(self.root, NAME) / f"out{self.count}"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(CONTENT)
        return place.name

    def _upload(self, sent: bytes) -> str:
        new = {"name": "a.csv", "size": len(CONTENT), "kind": "scan"}
        new["sha256"] = hashlib.sha256(CONTENT).hexdigest()
        made = str(self.admin.post(f"{HERE}/uploads", json=new).raise_for_status().json()["id"])
        if sent:
            head = {"Upload-Offset": "0", "Content-Type": "application/octet-stream"}
            self.admin.patch(f"{HERE}/uploads/{made}", content=sent, headers=head)
        return made

    def name(self, case: schemathesis.Case, rng: random.Random) -> None:
        """Replace what a path names by what is there."""
        case.path_parameters = dict(case.path_parameters or {})
        names = case.path_parameters
        known = self.there.get(case.path) or self.there.get(f"{case.path[:-1]}:path}}")
        given = dict(rng.choice(known)) if known else {}
        ends = case.method != "GET" and case.method != "HEAD"
        for parameter in names:
            if parameter == "workspace":
                names[parameter] = NAME
            elif parameter in given and not ends:
                names[parameter] = given[parameter]
            elif parameter in ("upload", "job", "token", "name") and (ends or not known):
                names[parameter] = self._fresh(parameter, case.path)
        query = {name: one for name, one in given.items() if name not in names}
        for odd in NAMING & (case.query or {}).keys():
            if rng.random() < 0.9:
                del case.query[odd]
        for part in QUERIES.get(case.path.rpartition("/")[2], "").split("&"):
            key, _, value = part.partition("=")
            if key and rng.random() < 0.5:
                query[key] = value
        case.query = {**(case.query or {}), **query}

    def body(self, case: schemathesis.Case, rng: random.Random) -> None:
        """Make bodies and headers such that the operation gets to its work more often."""
        if case.path.endswith("/jobs") and case.method == "POST" and isinstance(case.body, dict):
            kind, example = rng.choice(sorted(EXAMPLES.items()))
            odd = {rng.choice(sorted(example)): rng.choice(ODD)} if rng.random() < 0.5 else {}
            case.body = {**case.body, "kind": kind.value, "after": []}
            case.body["parameters"] = {**self._with_uploads(example), **odd}
        if case.path.endswith("/uploads") and case.method == "POST" and isinstance(case.body, dict):
            case.body = {**case.body, "size": rng.randint(0, 10_000)}
        if case.method == "PATCH":
            case.headers = {**(case.headers or {}), "Upload-Offset": "0"}
            case.body = rng.randbytes(rng.randint(0, 2 * len(CONTENT)))

    def _with_uploads(self, value: Any) -> Any:
        """Return an example with uploads that are there for those that it names."""
        if isinstance(value, dict):
            return {key: self._with_uploads(one) for key, one in value.items()}
        if isinstance(value, list):
            return [self._with_uploads(one) for one in value]
        is_id = isinstance(value, str) and len(value) == 4 and any(c.isdigit() for c in value)
        return self.there[f"{BASE}/uploads/{{upload}}"][0]["upload"] if is_id else value


ODD = (
    None, True, 0, -1, 2**70, 1e308, "", "\u0000", "../..", "x" * 1001, "é", [], {}, [[]],
    {"": None}, ["a"], {"mapolas": {"gsd_m": "x"}}, "nan",
)  # fmt: skip
"""What a parameter of a job is, where it is none."""


def main() -> int:
    """Print the numbers of inputs and answers; return 1 if one was wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--examples", type=int, default=100, help="of each operation")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workspace", type=Path, help="a workspace in which all stages ran")
    options = parser.parse_args()
    tally, begun, operations = Tally(), time.monotonic(), 0
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder, "served")
        make_workspace(Path(folder), root / NAME, options.workspace)
        server = ServerProcess(root, "--workers", "1")
        try:
            with server.client() as client:
                asked = prepared(client, root)
                described = client.get("/api/v1/openapi.json").json()
                for found in schemathesis.openapi.from_dict(described).get_all_operations():
                    operation = found.ok()
                    if operation.path.endswith("/events"):
                        continue
                    operations += 1
                    rule = described["paths"][operation.path][operation.method]["x-spcola-rule"]
                    ask = asking(server.url, asked, operation, rule.get("scope"), tally, options)
                    seeded(options.seed)(ask)()
                alive = client.get("/health").status_code == 200
        finally:
            server.kill()
    return printed(tally, operations, time.monotonic() - begun, alive=alive)


def make_workspace(work: Path, place: Path, given: Path | None) -> None:
    """Make a mission in which all stages ran, or copy it."""
    if given is not None:
        shutil.copytree(given, place, symlinks=True)
        return
    run("truth", "make", work / "mission", "--preset", "tiny")
    run("init", place, "--spc", work / "mission" / "spc", "--body", "Truth")
    run("import", place, *sorted((work / "mission" / "lidar").iterdir()))
    run("run", place)


def prepared(client: httpx.Client, root: Path) -> Asked:
    """Make an upload, an output and jobs that have ended, which inputs may name."""
    new = {"name": "a.csv", "size": len(CONTENT), "kind": "scan"}
    new["sha256"] = hashlib.sha256(CONTENT).hexdigest()
    client.post(f"{HERE}/uploads", json=new).raise_for_status()
    given = {"name": "imported", "folder": "spc"}
    for kind, parameters in (("solution-export", given), ("run", {"stages": ["mapolas"]})):
        body = {"kind": kind, "parameters": parameters}
        job = client.post(f"{HERE}/jobs", json=body).raise_for_status().json()["id"]
        while client.get(f"/api/v1/jobs/{job}").json()["state"] in ("waiting", "running"):
            time.sleep(0.1)
    return Asked(client, root)


def asking(
    url: str, asked: Asked, operation: Any, needed: str | None, tally: Tally,
    options: argparse.Namespace,
) -> Any:  # fmt: skip
    """Return a property of hypothesis that asks one operation."""
    enough = SCOPES[SCOPES.index(needed) :] if needed else SCOPES
    short = SCOPES[: SCOPES.index(needed)] if needed else []
    client, rng = httpx.Client(base_url=url, timeout=60), random.Random(options.seed)

    @settings(
        max_examples=options.examples, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(case=operation.as_strategy())
    def ask(case: schemathesis.Case) -> None:
        number = sum(tally.answers.values())
        if number % 10:
            asked.name(case, rng)
            asked.body(case, rng)
        refused = bool(short) and number % 10 == 5
        token = asked.tokens[rng.choice(short if refused else enough)]
        sent = case.as_transport_kwargs(base_url=url.rstrip("/"))
        sent["content"] = sent.pop("data", None)
        sent["headers"] = {**sent.get("headers", {}), "Authorization": f"Bearer {token}"}
        try:
            answer = client.request(**{key: sent[key] for key in KNOWN & sent.keys()})
        except (httpx.InvalidURL, httpx.LocalProtocolError, UnicodeEncodeError):
            tally.answers[0] += 1  # the client itself refuses to send it
            return
        tally.add(case, answer, refused=refused)

    return ask


def printed(tally: Tally, operations: int, seconds: float, *, alive: bool) -> int:
    """Print the numbers; return 1 if something was wrong."""
    total = sum(tally.asked.values())
    missed = sum(sum(one.values()) for one in tally.unreached.values())
    share = (total - missed) / total
    print(f"{total} inputs for {operations} operations in {seconds:.0f} s; reached {share:.0%}")
    print("answers: " + ", ".join(f"{n} × {code}" for code, n in sorted(tally.answers.items())))
    for name, codes in sorted(tally.unreached.items(), key=lambda one: -sum(one[1].values()))[:8]:
        print(f"    not reached: {name}: {dict(codes)} of {tally.asked[name]}")
    print(f"uploads without room on the disk: {tally.full}")
    print(f"wrong: {len(tally.wrong)} (limit 0); the server answers at the end: {alive}")
    for one in tally.wrong[:10]:
        print(f"    {one}")
    return int(bool(tally.wrong) or not alive or share < 0.8)


if __name__ == "__main__":
    sys.exit(main())
