"""The audit of packages finds what is known, and never takes no answer for a good one."""

from __future__ import annotations

import json
import runpy
from pathlib import Path
from typing import Any

import pytest

AUDIT: Any = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "lib" / "audit.py"))
SOUND = {"name": "a", "version": "1", "vulns": []}
FLAWED = {"name": "b", "version": "2", "vulns": [{"id": "CVE-1", "fix_versions": ["2.1"]}]}
SKIPPED = {"name": "c", "skip_reason": "not found"}
NPM = {"vulnerabilities": {}, "metadata": {"dependencies": {"total": 60}}}
FLAW = {"minimist": {"severity": "critical", "range": "<1.2.6"}}


@pytest.mark.parametrize(
    ("packages", "code", "says"),
    [
        ([SOUND], 0, "1 packages audited"),
        ([SOUND, FLAWED], 1, "VULNERABLE b 2: CVE-1, mended in 2.1"),
        ([SKIPPED, FLAWED], 1, "VULNERABLE b 2"),
        # pip-audit exits with 0 there.
        ([SOUND, SKIPPED], 3, "NOT AUDITED (1 of 2 packages: not found)"),
        (None, 3, "NOT AUDITED (no route)"),
    ],
)
def test_python_packages(packages: Any, code: int, says: str, capsys: Any) -> None:
    output = "" if packages is None else json.dumps({"dependencies": packages})
    errors = "WARNING: x\nno route https://example.org/\n"
    assert AUDIT["report"]("Python", AUDIT["python_verdict"](output, errors)) == code
    assert says in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "code", "says"),
    [
        (NPM, 0, "60 packages audited"),
        ({**NPM, "vulnerabilities": FLAW}, 1, "VULNERABLE minimist: critical, versions <1.2.6"),
        ({"message": "405 - POST https://example.org/x"}, 3, "NOT AUDITED (405 - POST)"),
        (None, 3, "NOT AUDITED (no answer)"),
    ],
)
def test_packages_of_the_page(content: Any, code: int, says: str, capsys: Any) -> None:
    output = "" if content is None else json.dumps(content)
    assert AUDIT["report"]("Page", AUDIT["npm_verdict"](output, "")) == code
    assert says in capsys.readouterr().out
