"""Links every dotted name of the program to the API, or to the line of its source.

A name in typewriter that begins with a package's name has to exist: if not, the build warns.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

from docutils import nodes
from docutils.utils import get_source_line
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import PythonLexer
from sphinx.application import Sphinx
from sphinx.util import logging

NAME = re.compile(r"(?!spcola\.toml$)(?:spcola|lidar|fusion)(?:\.\w+)+")
FOLDER = "_code"
PACKAGES = ("spcola", "lidar", "fusion")
CHECKOUT = Path(__file__).resolve().parents[2]
logger = logging.getLogger(__name__)


def split(name: str) -> tuple[str, list[str]]:
    """Part a dotted name into its module and what is in it.

    Raises
    ------
    ImportError, AttributeError
        If there is no such name.
    """
    head, *rest = name.split(".")
    value: Any = import_module(head)
    module = head
    while rest and hasattr(value, "__path__") and find_spec(f"{module}.{rest[0]}"):
        module = f"{module}.{rest.pop(0)}"
        value = import_module(module)
    for number, part in enumerate(rest):
        fields = {
            **getattr(value, "model_fields", {}),
            **getattr(value, "__dataclass_fields__", {}),
        }
        value = getattr(value, part) if hasattr(value, part) else fields[part].default
        # A name that a package takes from one of its modules is shown where it is written.
        if number == 0:
            function = getattr(value, "py_func", value)
            home = getattr(function, "__module__", None)
            if (
                isinstance(home, str)
                and home.split(".")[0] == head
                and hasattr(function, "__qualname__")
            ):
                module = home
    return module, rest


def line_of(module: str, parts: list[str]) -> int:
    """Line at which a name is defined in a module; 1 if it is not found."""
    spec = find_spec(module)
    tree: Any = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    line = 1
    for part in parts:
        tree = next((node for node in tree.body if part in names(node)), None)
        if tree is None:
            return line
        line = tree.lineno
        if not hasattr(tree, "body"):
            break
    return line


def names(node: ast.stmt) -> Iterator[str]:
    """Yield the names that a statement defines."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        yield node.name
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    for target in targets:
        if isinstance(target, ast.Name):
            yield target.id
        elif isinstance(target, ast.Tuple):
            yield from (part.id for part in target.elts if isinstance(part, ast.Name))


def address(app: Sphinx, name: str, docname: str) -> str:
    """Where a name is shown: in the API, else in its source.

    Raises
    ------
    ImportError, AttributeError, KeyError
        If there is no such name.
    """
    known = app.env.get_domain("py").objects
    if name in known:
        entry = known[name]
        return app.builder.get_relative_uri(docname, entry.docname) + f"#{entry.node_id}"
    module, parts = split(name)
    line = line_of(module, parts)
    app.env.shown_code.add(module)
    return app.builder.get_relative_uri(docname, f"{FOLDER}/{module}") + f"#L-{line}"


def link(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Turn names of the program into links."""
    for node in list(doctree.findall(nodes.literal)):
        name = node.astext()
        if not NAME.fullmatch(name) or isinstance(node.parent, nodes.reference | nodes.title):
            continue
        try:
            uri = address(app, name, docname)
        except (ImportError, AttributeError, KeyError) as error:
            logger.warning("%s does not exist: %s", name, error, location=node)
            continue
        reference = nodes.reference("", "", internal=True, refuri=uri)
        node.replace_self(reference)
        reference += node


def find(
    app: Sphinx, _env: Any, node: nodes.Element, content: nodes.Element
) -> nodes.reference | None:
    """Find what a docstring refers to and no page of the API has."""
    if node.get("refdomain") != "py":
        return None
    target, source = node["reftarget"], str(get_source_line(node)[0] or "")
    homes = [node.get("py:module") or ""]
    # A docstring may be shown by a package that took its subject from one of its modules.
    file, _, shown = source.partition(":docstring of ")
    homes += [shown.rpartition(".")[0], shown.rpartition(".")[0].rpartition(".")[0]]
    if Path(file).is_relative_to(CHECKOUT):
        homes.append(".".join(Path(file).relative_to(CHECKOUT).with_suffix("").parts))
    within = [home for home in homes if home]
    within += [f"{home}.{node['py:class']}" for home in within if node.get("py:class")]
    for name in (target, *(f"{home}.{target}" for home in within)):
        if name.split(".")[0] not in PACKAGES:
            continue
        try:
            uri = address(app, name, node["refdoc"])
        except (ImportError, AttributeError, KeyError):
            continue
        return referring(uri, content)
    # A summary in a table does not say in which module its docstring is.
    public = (one for one in app.env.get_domain("py").objects if one.endswith(f".{target}"))
    inner = (f"{module}.{target}" for home in within for module in inner_modules(home))
    for name in (*sorted(public), *inner):
        try:
            return referring(address(app, name, node["refdoc"]), content)
        except (ImportError, AttributeError, KeyError):
            continue
    return None


def inner_modules(package: str) -> list[str]:
    """Names of all modules of a package; none if there is no such package."""
    try:
        folder = import_module(package).__path__
    except (ImportError, AttributeError):
        return []
    return [module.name for module in walk_packages(folder, f"{package}.")]


def referring(uri: str, content: nodes.Element) -> nodes.reference:
    """Make a link of `content`."""
    reference = nodes.reference("", "", internal=True, refuri=uri)
    reference += content
    return reference


def pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield a page of highlighted source for each module that a page names."""
    shape = HtmlFormatter(nowrap=False, lineanchors="L", linenos=False)
    for module in sorted(app.env.shown_code):
        text = Path(find_spec(module).origin).read_text(encoding="utf-8")
        body = f"<h1>{module}</h1>\n" + highlight(text, PythonLexer(), shape)
        yield f"{FOLDER}/{module}", {"title": module, "body": body}, "page.html"


def begin(app: Sphinx) -> None:
    """Forget which modules pages of the last build named."""
    app.env.shown_code = set()


def setup(app: Sphinx) -> dict[str, bool]:
    """Link after all references are resolved; write the source pages at the end."""
    app.connect("builder-inited", begin)
    app.connect("missing-reference", find)
    app.connect("doctree-resolved", link)
    app.connect("html-collect-pages", pages)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
