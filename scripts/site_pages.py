"""Pages for MkDocs beyond the written ones: help of commands, tables of records, and equations as MathML.

`mkdocs.yml` names this file as a hook. Browsers render MathML themselves, so that a reader of the site fetches
nothing from elsewhere.
"""

from __future__ import annotations

import ast
import contextlib
import html
import io
import itertools
import os
import re
from pathlib import Path

import griffe
import latex2mathml.converter

from warp_trunk.cli import main
from warp_trunk.cli.commands import COMMANDS

ROOT = Path(__file__).parents[1]
HELP = "<!-- help of every command -->"
"""The line of `docs/commands.md` that is replaced by the help of every command."""
FIELDS = re.compile(r"<!-- fields of (\S+) in (\S+) -->")
"""A line that is replaced by a table of the fields of a dataclass in a source."""
MATH = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
"""An equation as `pymdownx.arithmatex` leaves it: between \\( and \\), or between \\[ and \\]."""

EXAMPLE = re.compile(r"^>>>.*?(?=\n\n|\Z)", re.DOTALL | re.MULTILINE)
"""An example of a docstring, up to the next empty line."""


class Examples(griffe.Extension):
    """Shows examples of docstrings as code; mkdocs.yml names it as an extension of mkdocstrings."""

    def on_instance(self, *, obj: griffe.Object, **_: object) -> None:
        """Puts a fence around each example."""
        if obj.docstring:
            obj.docstring.value = EXAMPLE.sub(r"```pycon\n\g<0>\n```", obj.docstring.value)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Fills in the help of every command and the tables of fields."""
    markdown = FIELDS.sub(lambda found: fields_of(found[1], ROOT / found[2]), markdown)
    if HELP in markdown:
        sections = (f"## {name}\n\n```text\n{help_of(name)}\n```" for name in COMMANDS)
        markdown = markdown.replace(HELP, "\n\n".join(sections))
    return markdown


def on_page_content(content: str, **_: object) -> str:
    """Replaces each equation of a page by MathML."""
    return MATH.sub(_mathml, content)


def help_of(command: str) -> str:
    """The output of `warp-trunk COMMAND --help-all`, in lines that fit the page."""
    os.environ["COLUMNS"] = "78"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        main([command, "--help-all"])
    return re.sub(r"\x1b\[[0-9;]*m", "", printed.getvalue()).strip()


def fields_of(name: str, source: Path) -> str:
    """A Markdown table of the fields of a dataclass: name, the docstring below it, and type."""
    nodes = ast.parse(source.read_text(encoding="utf-8")).body
    body = next(node.body for node in nodes if isinstance(node, ast.ClassDef) and node.name == name)
    rows = ["| entry | meaning | type |", "|---|---|---|"]
    for field, text in itertools.pairwise(body):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
        ):
            kind = re.sub(r"^Annotated\[(.*), \S+\]$", r"\1", ast.unparse(field.annotation)).replace("|", "or")
            meaning = " ".join(str(text.value.value).split())
            rows.append(f"| `{ast.unparse(field.target)}` | {meaning} | {kind} |")
    return "\n".join(rows)


def _mathml(equation: re.Match[str]) -> str:
    display = "block" if equation[2] == "[" else "inline"
    converted = latex2mathml.converter.convert(html.unescape(equation[3]).strip(), display=display)
    if "\\" in converted:
        raise ValueError(f"latex2mathml does not know a command of {equation[3]!r}; write it otherwise")
    return converted
