"""Writes the reference from the code: settings, JSON keys, codes, commands, equations, API.

A page asks for one of these by a line ``% generated: NAME``. The API has one page for each package,
and each module at a package's top, that states its public names (``__all__``).
"""

from __future__ import annotations

import ast
import inspect
import json
import re
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from pkgutil import walk_packages
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

from sphinx.application import Sphinx
from sphinx.util import logging
from sourcelinks import names as defined
from typer.core import TyperArgument
from typer.main import get_command

from fusion.cli.app import COMMANDS, command_line
from fusion.client.steps import Blocking, call, stream
from fusion.workspace.settings.ranges import range_text
from fusion.service.api import Service, create_app
from fusion.service.store import Store
from fusion.registration.results.keys import REGISTRATION_KEYS
from fusion.stages.albedo import ALBEDO_KEYS
from fusion.stages.lithos import PHOTOCLINOMETRY_KEYS
from fusion.stages.photometry import PHOTOMETRY_KEYS
from fusion.stages.spc_register import STATES_KEYS
from fusion.scaling.results.keys import SCALE_KEYS
from fusion.workspace.settings.settings import Settings, table_models
from fusion.estimation.verdict import Cause, Code
from spcola.photometry.functions import PHOTOMETRIC_FUNCTIONS

MARKER = re.compile(r"^% generated: (\w+)$", re.MULTILINE)
API = "reference/api"
PACKAGES = ("spcola", "lidar", "fusion")
GALLERY = Path(__file__).resolve().parents[1] / "gallery"
logger = logging.getLogger(__name__)


def row(*cells: str) -> str:
    """One row of a Markdown table."""
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of a Markdown table."""
    return [row(*head), row(*["---"] * len(head)), *(row(*cells) for cells in rows), ""]


def literal(value: Any) -> str:
    """A default value as one writes it into ``spcola.toml``."""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, list) and value and hasattr(value[0], "name"):
        return ", ".join(f"`{entry.name}`" for entry in value)
    return f"`{value}`".replace("'", '"')


def settings() -> str:
    """One section for each table of the settings."""
    lines: list[str] = []
    defaults = {
        info.alias or name: getattr(Settings(), name)
        for name, info in Settings.model_fields.items()
    }
    for name, model in table_models().items():
        about = inspect.getdoc(model) or ""
        text = about.partition(": ")[2]
        lines += [f"## [{name}]", "", text[:1].upper() + text[1:], ""]
        rows = []
        for key, info in model.model_fields.items():
            words = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
            choices = f" One of {', '.join(literal(word) for word in words)}." if words else ""
            limits = range_text(info.annotation, info.metadata).strip()
            meaning = f"{info.description}.{choices} {limits}".strip()
            rows.append((f"`{key}`", literal(getattr(defaults[name], key)), meaning))
        lines += table(("key", "default", "meaning"), rows)
    return "\n".join(lines)


def keys(of: Mapping[str, str], written: Path) -> str:
    """A table of JSON keys; what a file has beyond them is warned of."""
    content = json.loads(written.read_text(encoding="utf-8"))
    for key in sorted(set(written_keys(content)) - set(of)):
        logger.warning("%s has the key %s, of which the code states no meaning", written.name, key)
    return meanings(of)


def meanings(of: Mapping[str, str]) -> str:
    """A table of JSON keys."""
    return "\n".join(table(("key", "what it is"), [(f"`{key}`", text) for key, text in of.items()]))


def photometric_functions() -> str:
    """A table of the parameters of photometric functions."""
    rows = [
        (f"`{function.name}`", f"`{one.name}`", f"{one.default:g}", f"{one.lower:g} to "
         f"{one.upper:g}", one.unit or "–", one.about)
        for function in PHOTOMETRIC_FUNCTIONS.values()
        for one in function.parameters
    ]  # fmt: skip
    head = "function", "parameter", "default", "allowed", "unit", "meaning"
    return "\n".join(table(head, rows))


def written_keys(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the keys of a file, and ``outer.inner`` of lists of entries."""
    for key, value in content.items():
        yield key
        if key.startswith("per_") and isinstance(value, list):
            yield from {f"{key}.{inner}" for entry in value for inner in entry}


def codes(of: type[Code | Cause]) -> str:
    """A table of codes with their meanings."""
    return "\n".join(table(("code", "meaning"), [(f"`{code}`", code.meaning) for code in of]))


def commands() -> str:
    """One section for each command, with its options."""
    group: Any = get_command(command_line())
    examples = {name: example for name, _, example in COMMANDS}
    lines: list[str] = []
    for name, what in group.commands.items():
        lines += command(what, f"spcola {name}", examples.get(name, ""))
    return "\n".join(lines)


def command(what: Any, name: str, example: str) -> Iterator[str]:
    """Lines of one command, and of those below it."""
    if hasattr(what, "commands"):
        for below, inner in what.commands.items():
            epilog = (inner.epilog or "").removeprefix("Example: ")
            yield from command(inner, f"{name} {below}", epilog)
        return
    yield from (f"## {name}", "", inspect.cleandoc(what.help or ""), "")
    if example:
        yield from ("```text", *(part.strip() for part in example.split(";")), "```", "")
    rows = []
    for parameter in what.params:
        names = [*parameter.opts, *parameter.secondary_opts]
        if isinstance(parameter, TyperArgument):
            names = [parameter.metavar or parameter.name.upper()]
        elif parameter.metavar:
            names[-1] += f" {parameter.metavar}"
        rows.append((f"`{', '.join(names)}`", parameter.help or ""))
    yield from table(("argument or option", "meaning"), rows)


def answers() -> str:
    """One section for each answer of the service in JSON, from the description of its interface."""
    with TemporaryDirectory() as folder, Store(Path(folder) / "store.sqlite") as store:
        described = create_app(Service(Path(folder), store)).openapi()
    lines: list[str] = []
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            good = next(one for code, one in operation["responses"].items() if code[0] == "2")
            content = good.get("content", {}).get("application/json", {})
            if "example" in content:
                text = json.dumps(content["example"], indent=1, ensure_ascii=False)
                lines += [f"### {method.upper()} {path}", "", "```json", text, "```", ""]
    return "\n".join(lines)


def equations(app: Sphinx) -> str:
    """Equation numbers in order, with their functions and the pages that explain them."""
    found: list[tuple[int, str, str, str]] = []
    for path in sorted(Path(app.srcdir, "explanation").glob("*.md")):
        for line in path.read_text(encoding="utf-8").splitlines():
            match = re.match(r"\| \[([\d–, ]+)\] ?(.*?) \| (.*) \|$", line)
            if match:
                first = int(re.match(r"\d+", match.group(1)).group())
                page = f"[{path.stem.replace('_', ' ')}](../explanation/{path.name})"
                found.append((first, f"[{match.group(1)}] {match.group(2)}", match.group(3), page))
    return "\n".join(
        table(("equation", "function", "explained in"), [entry[1:] for entry in sorted(found)])
    )


def api_index(_app: Sphinx) -> str:
    """List of all packages that state their public names."""
    lines = ["```{toctree}", ":maxdepth: 1", ""]
    lines += [f"api/{package.__name__}" for package in public_packages()]
    return "\n".join([*lines, "```"])


def public_packages() -> list[ModuleType]:
    """Packages and modules that state what they offer, by ``__all__``."""
    found = []
    for top in PACKAGES:
        package = import_module(top)
        inner = list(walk_packages(package.__path__, f"{top}."))
        offering = [m.name for m in inner if m.ispkg or "\n__all__ = " in module_text(m.name)]
        found += [
            module
            for module in map(import_module, [top, *offering])
            if getattr(module, "__all__", ())
        ]
    return found


def module_text(name: str) -> str:
    """The source of a module, which is not imported for it."""
    spec = find_spec(name)
    origin = None if spec is None else spec.origin
    return "" if origin is None else Path(origin).read_text(encoding="utf-8")


def public_members(value: type) -> list[str]:
    """Public methods and properties that a class states itself."""
    kinds = (property, classmethod, staticmethod)
    # The calls of a session are those of its bases; one that is awaited has the same.
    calls = [
        name
        for base in (value.__mro__ if issubclass(value, Blocking) else ())
        for name, member in vars(base).items()
        if isinstance(member, call | stream)
    ]
    return calls + [
        name
        for name, member in vars(value).items()
        if not name.startswith("_")
        and name not in getattr(value, "__dataclass_fields__", {})
        and (inspect.isfunction(member) or isinstance(member, kinds))
    ]


def homes(packages: list[ModuleType]) -> dict[int, str]:
    """By identity of what is public, the package that describes it: the innermost one."""
    found: dict[int, str] = {}
    for package in sorted(packages, key=lambda one: one.__name__.count(".")):
        for public in package.__all__:
            found[id(getattr(package, public))] = package.__name__
    return found


def api_page(package: ModuleType, home: Mapping[int, str]) -> str:
    """The page of one package, as reStructuredText; what inner packages describe is linked."""
    name = package.__name__
    head = [f"``{name}``", "=" * (len(name) + 4), ""]
    lines = [*head, f".. automodule:: {name}", "   :no-members:", ""]
    values = {public: getattr(package, public) for public in sorted(package.__all__)}
    # Equal numbers may be one object: a constant is described by every package that has it.
    own = [
        public for public, value in values.items() if is_constant(value) or home[id(value)] == name
    ]
    if own:
        lines += [".. autosummary::", "", *(f"   {public}" for public in own), ""]
    lines += [
        f"* :py:obj:`{public} <{home[id(value)]}.{public}>`: {summary(value)}"
        for public, value in values.items()
        if public not in own
    ]
    for public in own:
        lines += ["", *description(package, public, values[public])]
    return "\n".join(lines) + "\n"


def is_constant(value: Any) -> bool:
    """Whether a public name is neither a class nor a function."""
    return not (isinstance(value, type) or inspect.isroutine(value) or hasattr(value, "py_func"))


def summary(value: Any) -> str:
    """First sentence of a docstring."""
    return (inspect.getdoc(value) or "").partition("\n")[0]


def description(package: ModuleType, public: str, value: Any) -> list[str]:
    """What describes one public name, and links to the examples that use it."""
    if isinstance(value, type):
        members = ", ".join(public_members(value))
        lines = [f".. autoclass:: {public}", *([f"   :members: {members}"] if members else [])]
        return [*lines, *examples(value)]
    if not is_constant(value):
        return [f".. autofunction:: {public}", *examples(value)]
    text = data_text(package, public)
    return [f".. py:data:: {public}", f"   :module: {package.__name__}", "", f"   {text}"]


def examples(value: Any) -> list[str]:
    """A line with links to the examples of the gallery that use a public name, if any."""
    links = []
    for path in sorted(GALLERY.glob("plot_*.py")):
        text = path.read_text(encoding="utf-8")
        names = set(re.findall(rf"(?<![\w.])({'|'.join(PACKAGES)})((?:\.\w+)+)", text))
        if any(leads_to(import_module(top), rest.split(".")[1:], value) for top, rest in names):
            links.append(f":doc:`{text.splitlines()[1]} </examples/{path.stem}>`")
    return ["", f"Used in the examples: {', '.join(links)}."] if links else []


def leads_to(start: Any, names: list[str], value: Any) -> bool:
    """Whether `value` is met on the way along attributes."""
    for name in names:
        start = getattr(start, name, None)
        if start is value:
            return True
    return False


def data_text(package: ModuleType, public: str) -> str:
    """The text below a constant, in whichever module of the package it is."""
    folders = getattr(package, "__path__", None)
    files = sorted(Path(folders[0]).rglob("*.py")) if folders else [Path(str(package.__file__))]
    for path in files:
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for one, below in pairwise(body):
            value = getattr(below, "value", None)
            if public in defined(one) and isinstance(getattr(value, "value", None), str):
                return " ".join(value.value.split())
    return ""


GENERATED: dict[str, Callable[[Sphinx], str]] = {
    "settings": lambda _: settings(),
    "registration_keys": lambda app: keys(REGISTRATION_KEYS, of_tutorial(app, "registration.json")),
    "scale_keys": lambda app: keys(SCALE_KEYS, of_tutorial(app, "scale.json")),
    "albedo_keys": lambda _: meanings(ALBEDO_KEYS),
    "photoclinometry_keys": lambda _: meanings(PHOTOCLINOMETRY_KEYS),
    "states_keys": lambda _: meanings(STATES_KEYS),
    "photometry_keys": lambda _: meanings(PHOTOMETRY_KEYS),
    "photometric_functions": lambda _: photometric_functions(),
    "codes": lambda _: codes(Code),
    "causes": lambda _: codes(Cause),
    "commands": lambda _: commands(),
    "equations": equations,
    "answers": lambda _: answers(),
    "api": api_index,
}


def of_tutorial(app: Sphinx, name: str) -> Path:
    """A file of the tutorial's workspace."""
    return Path(app.config.TUTORIAL, "ws", name)


def write_api(app: Sphinx) -> None:
    """Write a page for each package; pages of packages that are gone are removed."""
    folder = Path(app.srcdir, API)
    folder.mkdir(parents=True, exist_ok=True)
    packages = public_packages()
    home = homes(packages)
    pages = {f"{package.__name__}.rst": api_page(package, home) for package in packages}
    for path in folder.glob("*.rst"):
        if path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def insert(app: Sphinx, _docname: str, source: list[str]) -> None:
    """Put in the place of each marker what it asks for."""
    source[0] = MARKER.sub(lambda match: GENERATED[match.group(1)](app), source[0])


def outdated(
    _app: Sphinx, env: Any, _added: set[str], _changed: set[str], _removed: set[str]
) -> list[str]:
    """Pages that ask for something generated are read anew: the code may have changed."""
    pages = (Path(env.doc2path(name)) for name in env.found_docs)
    written = [
        page for page in pages if page.suffix == ".md" and MARKER.search(page.read_text("utf-8"))
    ]
    return [env.path2doc(page) for page in written]


def setup(app: Sphinx) -> dict[str, bool]:
    """Write pages before anything is read, and tables as pages are read."""
    app.connect("builder-inited", write_api, priority=50)
    app.connect("env-get-outdated", outdated)
    app.connect("source-read", insert)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
