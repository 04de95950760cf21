"""Reference pages made from the program, kept in docs/ so that they read without a site.

A block of a page between `<!-- made from X -->` and `<!-- end of X -->` is the help of a command (`warp-trunk X`),
a public name (`warp_trunk.simulate`) or the fields of a record (`fields of warp_trunk.results.Summary`).
`python scripts/reference_pages.py` writes every block again.
"""

import ast
import contextlib
import importlib
import inspect
import io
import itertools
import os
import re
import textwrap
from functools import cached_property
from pathlib import Path
from typing import Any

from warp_trunk.cli import main

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"(<!-- made from (?P<name>.+?) -->\n).*?(<!-- end of (?P=name) -->)", re.DOTALL)
SECTION = re.compile(r"^(Args|Returns|Yields|Raises):\n((?:    .*\n?|\n)+)", re.MULTILINE)
"""A section of a docstring in Google style."""
EXAMPLE = re.compile(r"^>>>.*?(?=\n\n|\Z)", re.DOTALL | re.MULTILINE)
"""An example of a docstring, up to the next empty line."""


def renewed(page: str) -> str:
    """The page with every block made from the program as it is."""
    return BLOCK.sub(lambda found: f"{found[1]}\n{made_from(found['name'])}\n\n{found[3]}", page)


def made_from(name: str) -> str:
    """The Markdown of a block."""
    if name.startswith("warp-trunk "):
        return f"```text\n{help_of(name.removeprefix('warp-trunk '))}\n```"
    of, _, path = name.rpartition(" ")
    module, _, attribute = path.rpartition(".")
    found = getattr(importlib.import_module(module), attribute)
    return fields_of(found) if of == "fields of" else described(attribute, found)


def help_of(command: str) -> str:
    """The output of `warp-trunk COMMAND --help-all`, in lines that fit a page."""
    os.environ["COLUMNS"] = "78"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        main([command, "--help-all"])
    return re.sub(r"\x1b\[[0-9;]*m", "", printed.getvalue()).strip()


def described(name: str, found: Any) -> str:
    """A function, or a class with its fields and methods: signature and docstring."""
    parts = [f"### {name}"]
    if not inspect.isclass(found):
        return "\n\n".join([*parts, _signature(name, found), _markdown(found)])
    parts.append(_markdown(found))
    if table := fields_of(found):
        parts.append(table)
    for member, value in vars(found).items():
        function = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if member.startswith("_") or not getattr(function, "__doc__", None):
            continue
        if isinstance(function, property | cached_property):
            parts.append(f"- `{name}.{member}`: {' '.join(_markdown(function).split())}")
        elif inspect.isfunction(function):
            parts += [f"#### {name}.{member}", _signature(member, function), _markdown(function)]
    return "\n\n".join(parts)


def _signature(name: str, function: Any) -> str:
    """A call with its annotations, which are texts, without their quotes."""
    bare = re.sub("(: |-> )'([^']*)'", r"\1\2", str(inspect.signature(function)))
    return f"```python\n{name}{bare}\n```"


def fields_of(record: type) -> str:
    """A table of the fields of a dataclass: name, the docstring below it, and type; empty for another class."""
    nodes = ast.parse(textwrap.dedent(inspect.getsource(record))).body[0]
    assert isinstance(nodes, ast.ClassDef)
    rows = []
    for field, text in itertools.pairwise(nodes.body):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
        ):
            kind = re.sub(r"Annotated\[(.*?), [^],]*\([^)]*\)\]", r"\1", ast.unparse(field.annotation)).replace(
                "|", "or"
            )
            meaning = " ".join(str(text.value.value).split()).replace("|", "\\|")
            rows.append(f"| `{ast.unparse(field.target)}` | {meaning} | {kind} |")
    return "\n".join(["| entry | meaning | type |", "|---|---|---|", *rows]) if rows else ""


def _markdown(found: Any) -> str:
    """A docstring as Markdown."""
    text = EXAMPLE.sub(r"```pycon\n\g<0>\n```", inspect.getdoc(found) or "")
    return SECTION.sub(lambda section: f"**{section[1]}**\n\n{_items(section[2])}\n", text).strip()


def _items(text: str) -> str:
    """The entries of a section, an item each; a line that is further in belongs to the entry before."""
    items: list[str] = []
    for line in textwrap.dedent(text).splitlines():
        if items and line.startswith(" "):
            items[-1] += f" {line.strip()}"
        elif line.strip():
            items.append(re.sub(r"^(\w+):", r"`\1`:", line.strip()))
    return "\n".join(f"- {item}" for item in items)


if __name__ == "__main__":
    for path in sorted(DOCS.glob("*.md")):
        page = path.read_text(encoding="utf-8")
        if (new := renewed(page)) != page:
            path.write_text(new, encoding="utf-8")
            print(f"{path.name} is written")
