"""Reference pages made from the program when the site is built; `site_pages.py` gives them to MkDocs.

The pages of commands and of Python are made as a whole. On other pages a line
`<!-- fields of warp_trunk.module.Record -->` becomes the table of the fields of a record, and
`<!-- quantities -->` that of all measured quantities.
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
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import warp_trunk
from warp_trunk.cli import main
from warp_trunk.cli.commands import COMMANDS
from warp_trunk.cli.output import EXIT_STATUSES
from warp_trunk.measures.quantities import QUANTITIES
from warp_trunk.measures.rows import as_markdown

FIELDS = re.compile(r"^<!-- fields of (?P<module>[\w.]+)\.(?P<record>\w+) -->$", re.MULTILINE)
SECTION = re.compile(r"^(Args|Returns|Yields|Raises):\n((?:    .*\n?|\n)+)", re.MULTILINE)
"""A section of a docstring in Google style."""
EXAMPLE = re.compile(r"^>>>.*?(?=\n\n|\Z)", re.DOTALL | re.MULTILINE)
"""An example of a docstring, up to the next empty line."""
PLACES = {"level": "each vertebra", "back": "the back", "curve": "each curve", "spine": "the spine"}
"""The part of the body of which a quantity of each group is measured."""
PYTHON = """# Python

The public names are imported from `warp_trunk`:

```python
import warp_trunk as wt

case = wt.read_case("patient")
plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.65, derotation=0.4)])
result = wt.simulate(case, plan, wt.RunOptions(bands=True))
result.save("results/t4_l1")
```

In a notebook a result shows the back before and after; [a notebook](first_simulation.ipynb) shows the whole
workflow. Everything else is imported from its module, for example `warp_trunk.engine.newton.Relaxer`."""
HEADINGS = {
    "Cases": ("case", "geometry", "io", "errors", "engine"),
    "From clinical data": ("preparation",),
    "Plans": ("bone_motion", "meshing"),
    "Simulation": ("run",),
    "Results": ("results", "report", "recording", "measures"),
}
"""Headings of the page of Python, each with the packages whose public names stand below it."""


def filled(page: str) -> str:
    """The page with the tables of the records that it names, and of the quantities."""
    return FIELDS.sub(_named_fields, page).replace("<!-- quantities -->", quantities_table())


def _named_fields(line: re.Match[str]) -> str:
    """The fields of a record; of constants with their range, and with their origin by the beginning of a name."""
    module = importlib.import_module(line["module"])
    ranges, origins = getattr(module, "RANGES", {}), getattr(module, "REFERENCES", {})
    more: dict[str, Callable[[str], str]] = {}
    if ranges:
        more["range"] = lambda name: "{:g} to {:g}".format(*ranges[name])
    if origins:
        more["origin"] = lambda name: next((words for key, words in origins.items() if name.startswith(key)), "")
    return fields_of(getattr(module, line["record"]), more)


def quantities_table() -> str:
    """Every measured quantity: its key, label and unit, and where it is measured."""
    rows = [
        (f"`{key}`", quantity.label, quantity.unit, PLACES[quantity.group]) for key, quantity in QUANTITIES.items()
    ]
    return as_markdown(["quantity", "label", "unit", "of"], rows)


def commands_page() -> str:
    """The page of all commands: exit statuses, and what `warp-trunk COMMAND --help-all` prints."""
    statuses = "\n".join(f"| {number} | {meaning} |" for number, meaning in EXIT_STATUSES.items())
    parts = [
        "# Commands and options",
        "`warp-trunk COMMAND --help` shows the options of a command that are used most, `--help-all` all of them.",
        f"| exit status | meaning |\n|---|---|\n{statuses}",
    ]
    for command in COMMANDS:
        parts += [f"## {command}", f"```text\n{help_of(command)}\n```"]
    return "\n\n".join(parts)


def python_page() -> str:
    """The page of the public names, below the headings of their packages."""
    parts = [PYTHON]
    public = {name: getattr(warp_trunk, name) for name in warp_trunk.__all__}
    for heading, packages in HEADINGS.items():
        named = {name: value for name, value in public.items() if value.__module__.split(".")[1] in packages}
        parts += [f"## {heading}", *(described(name, value) for name, value in named.items())]
    return "\n\n".join(parts)


def help_of(command: str) -> str:
    """The output of `warp-trunk COMMAND --help-all`, in lines that fit a page."""
    os.environ["COLUMNS"] = "78"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        main([command, "--help-all"])
    return re.sub(r"\x1b\[[0-9;]*m", "", printed.getvalue()).strip()


def described(name: str, source: Any) -> str:
    """A function, or a class with its fields and methods: signature and docstring."""
    parts = [f"### {name}"]
    if not inspect.isclass(source):
        return "\n\n".join([*parts, _signature(name, source), _markdown(source)])
    parts.append(_markdown(source))
    if table := fields_of(source):
        parts.append(table)
    for member, value in vars(source).items():
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


def fields_of(record: type, more: Mapping[str, Callable[[str], str]] | None = None) -> str:
    """A table of the fields of a dataclass: name, the docstring below it, and type; or the default and the columns
    `more` by their heads, from the name. Empty for another class."""
    nodes = ast.parse(textwrap.dedent(inspect.getsource(record))).body[0]
    assert isinstance(nodes, ast.ClassDef)
    rows = []
    for field, text in itertools.pairwise(nodes.body):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
        ):
            name, kind = ast.unparse(field.target), ast.unparse(field.annotation)
            cells = [f"`{name}`", " ".join(str(text.value.value).split()).replace("|", "\\|")]
            if more:
                cells += [f"{getattr(record, name):g}", *(cell(name) for cell in more.values())]
            else:
                cells.append(re.sub(r"Annotated\[(.*?), [^],]*\([^)]*\)\]", r"\1", kind).replace("|", "or"))
            rows.append(f"| {' | '.join(cells)} |")
    heads = ("entry", "meaning", *(("default", *more) if more else ("type",)))
    return "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *rows]) if rows else ""


def _markdown(source: Any) -> str:
    """A docstring as Markdown."""
    text = EXAMPLE.sub(r"```pycon\n\g<0>\n```", inspect.getdoc(source) or "")
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
