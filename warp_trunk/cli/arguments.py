"""Flags of the command line, made of the fields of a command's dataclass."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import is_dataclass, replace
from types import NoneType
from typing import Any, get_args, get_type_hints

import tyro
from tyro.conf import OmitArgPrefixes, UseAppendAction
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructTypeInfo,
)

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import number

from .typos import explained

_registry = ConstructorRegistry()


@_registry.primitive_rule
def _whole_numbers(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[int] | None:
    """Whole numbers may be written as 1e5, too."""
    if info.type is not int:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: whole_number(words[0]),
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    )


@_registry.primitive_rule
def _may_be_left_out(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """A value or nothing is asked for as the value: `None` is no word for a command line."""
    kinds = get_args(info.type)
    if NoneType not in kinds or len(kinds) != 2:
        return None
    (kind,) = (kind for kind in kinds if kind is not NoneType)
    found = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kind, info.markers))
    if not isinstance(found, PrimitiveConstructorSpec):
        return None
    return replace(
        found,
        is_instance=lambda value: value is None or found.is_instance(value),
        str_from_instance=lambda value: ["unset"] if value is None else found.str_from_instance(value),
    )


_being_described: set[Any] = set()
"""Classes whose fields tyro is describing; it asks the rule below for them again."""


@_registry.struct_rule
def _help_in_one_paragraph(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Help as the terminal is wide: tyro keeps the line breaks of docstrings where the next line is indented."""
    if not is_dataclass(info.type) or info.type in _being_described:
        return None
    _being_described.add(info.type)
    try:
        found = ConstructorRegistry.get_struct_spec(info)
    finally:
        _being_described.remove(info.type)
    if not isinstance(found, StructConstructorSpec):
        return None
    return replace(
        found, fields=tuple(replace(field, helptext=_flowing(field.helptext)) for field in found.fields)
    )


def _flowing(text: str | Callable[[], str | None] | None) -> Callable[[], str | None]:
    """The text, found only when it is shown, with a space for each break."""

    def found() -> str | None:
        known = text() if callable(text) else text
        return known and " ".join(known.split())

    return found


def whole_number(text: str) -> int:
    """A whole number, also one written as 1e5 or 2.0; ValueError for any other text."""
    value = number(text)
    if not value.is_integer():  # nor is infinity or NaN
        raise ValueError(f"not a whole number: '{text}'")
    return int(value)


def parse(command: Any, arguments: Sequence[str], default: Any = None) -> Any:
    """The command of a class that the words after `warp-trunk`, its name first, ask for.

    Raises:
        InputError: arguments that do not fit; SystemExit where they ask for help.
    """
    name, *words = arguments
    if twice := _given_twice(command, words):
        raise InputError(f"{twice}: is given more than once, and only the last one would count; give it once")
    said = io.StringIO()
    options = {} if default is None else {"default": default}
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                OmitArgPrefixes[command], prog=f"warp-trunk {name}", args=words, registry=_registry, **options
            )
    except SystemExit as end:
        if not end.code:
            raise
        line = one_line(said.getvalue())
        raise InputError(explained(name, words, line, command) or line) from None


def _given_twice(command: Any, words: Sequence[str]) -> str | None:
    """The first option that is given again, though it is not one that may be repeated."""
    hints = get_type_hints(command, include_extras=True)
    repeatable = {name for name, hint in hints.items() if UseAppendAction in getattr(hint, "__metadata__", ())}
    seen: set[str] = set()
    for word in words:
        option = word.partition("=")[0]
        field = option.removeprefix("--").replace("-", "_")
        if option.startswith("--") and field not in repeatable:
            if field in seen:
                return option
            seen.add(field)
    return None


def one_line(box: str) -> str:
    """The message in the box that tyro draws around it, in one line, without its title and the hint for help."""
    plain_box = re.sub(r"\x1b\[[0-9;]*m", "", box)  # colours, on a terminal
    rows = [row.strip(" │") for row in plain_box.splitlines()]
    rows = [row for row in rows if row and row[0] not in "╭╰"]
    if "╭" not in plain_box and len(rows) > 1 and _is_rule(rows[1]):
        rows = rows[2:]  # where the terminal has no box characters, the title stands over a rule
    end = next((i for i, row in enumerate(rows) if _is_rule(row)), len(rows))
    hint = [f"({row})" for row in rows[end:] if row.startswith("Available subcommands")]
    text = " ".join(" ".join([*rows[:end], *hint]).split())
    text = re.sub(r"^Error parsing (__tyro-dummy-inner__[\w.-]*|[a-z_.]+): ", "", text)
    return text or "the arguments do not fit"


def _is_rule(row: str) -> bool:
    return set(row) <= {"─", "-"}
