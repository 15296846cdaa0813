"""Whether answers are what the description of the interface has of them."""

from __future__ import annotations

from typing import Any

import httpx
import jsonschema


def faults_of(
    described: dict[str, Any], method: str, path: str, answer: httpx.Response
) -> list[str]:
    """Return what is wrong with an answer: status, media type, headers, or content."""
    operation = described["paths"][path.replace(":path", "")][method.lower()]
    answers, status = operation["responses"], str(answer.status_code)
    found = answers.get(status) or answers.get(f"{status[0]}XX")
    if found is None:
        return [f"{status} is not described"]
    if "$ref" in found:
        found = described["components"]["responses"][found["$ref"].rpartition("/")[2]]
    faults = [f"no header {name}" for name in found.get("headers", {}) if _is_missing(name, answer)]
    kind = answer.headers.get("content-type", "").partition(";")[0]
    content = found.get("content", {})
    if not content or method == "HEAD":
        return [*faults, *(["it is not empty"] if answer.content else [])]
    if kind not in content and "*/*" not in content:
        return [*faults, f"{kind!r} is not described"]
    if kind.endswith("json") and "*/*" not in content:
        faults += invalid(described, content[kind]["schema"], answer.json())
    return faults


def invalid(described: dict[str, Any], schema: dict[str, Any], content: Any) -> list[str]:
    """Return where content differs from a schema of the description."""
    whole = {**schema, "components": described["components"]}
    errors = jsonschema.Draft202012Validator(whole).iter_errors(content)
    return [f"{error.json_path}: {error.message[:200]}" for error in errors][:5]


def examples_in(described: dict[str, Any]) -> dict[str, tuple[dict[str, Any], Any]]:
    """Return the schema and the example of each answer in JSON, by method and path."""
    found = {}
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            for code, answer in operation["responses"].items():
                content = answer.get("content", {}).get("application/json", {})
                if code.startswith("2") and content:
                    name = f"{method.upper()} {path}"
                    found[name] = (content["schema"], content.get("example"))
    return found


def _is_missing(name: str, answer: httpx.Response) -> bool:
    return name.lower() not in answer.headers and name != "Link"
