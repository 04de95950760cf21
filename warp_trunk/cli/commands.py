"""The commands by name, each in a file of its own that is loaded only when it is asked for."""

from __future__ import annotations

import ast
import difflib
import importlib
import keyword
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from warp_trunk.errors import InputError

COMMANDS = {
    "demo": "Demo",
    "doctor": "Doctor",
    "close": "Close",
    "triangulate": "Triangulate",
    "register": "Register",
    "fit-atlas": "FitAtlas",
    "import": "Import",
    "landmarks": "FindLandmarks",
    "plan": "Plan",
    "make-case": "MakeCase",
    "cut": "Cut",
    "simulate": "Simulate",
    "view": "View",
    "report": "Report",
    "measure": "Measure",
    "export": "Export",
    "cohort": "Cohort",
    "calibrate": "Calibrate",
}
"""The class of each command, in the order in which they are used: first steps, from a patient to a case, from
there to a result, and many of them."""


def load(words: list[str]) -> Any:
    """The class of the command that the first word names.

    Raises:
        InputError: there is no word, or no such command.
    """
    known = ", ".join(COMMANDS)
    if not words:
        raise InputError(f"a command is needed: one of {known}; start with warp-trunk demo")
    name = words[0]
    if name not in COMMANDS:
        raise InputError(f"'{name}': there is no such command{nearest(name, COMMANDS)}; known are {known}")
    module = importlib.import_module(f".{_module(name)}", __package__)
    return getattr(module, COMMANDS[name])


def overview() -> str:
    """The text of `warp-trunk --help`: each command with the first sentence of its documentation."""
    width = max(map(len, COMMANDS)) + 4
    lines = ["usage: warp-trunk COMMAND ...", ""]
    lines += ["Predict how the trunk of a scoliosis patient looks after spine surgery.", ""]
    for name in COMMANDS:
        lines += textwrap.wrap(
            _sentence(name), 100, initial_indent=f"  {name:<{width}}", subsequent_indent=" " * (width + 2)
        )
    return "\n".join([*lines, "", "warp-trunk COMMAND --help lists the options of each."])


def nearest(word: str, known: Iterable[str]) -> str:
    """A question for the known word that is most like a word; nothing where none is."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def _module(name: str) -> str:
    """The file of a command; a word of Python's own cannot be the name of a module."""
    return f"{name}_case" if keyword.iskeyword(name) else name.replace("-", "_")


def _sentence(name: str) -> str:
    """The first sentence of a command's documentation, read from its file without loading it."""
    source = Path(__file__).with_name(f"{_module(name)}.py").read_text(encoding="utf-8")
    for node in ast.parse(source).body:
        if isinstance(node, ast.ClassDef) and node.name == COMMANDS[name]:
            return " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split())
    raise LookupError(f"{name}: its file has no class {COMMANDS[name]}")
