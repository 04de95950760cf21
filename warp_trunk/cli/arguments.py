"""Flags of the command line, made of the fields of a command's dataclass by tyro."""

import io
import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import is_dataclass, replace
from functools import partial
from types import NoneType
from typing import Any, get_args, get_type_hints

import tyro
from tyro.conf import OmitArgPrefixes, Suppress, UseAppendAction
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructTypeInfo,
)

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError

NARROWEST = 40
"""Columns of a screen for which help is laid out at least; tyro never ends in fewer than about ten."""
ONLY_IN_PYTHON = frozenset({"radius_edge_ratio", "constants", "preset"})
"""Fields that are no options of a command: only studies need them, or other options fill them."""


class SomeConstants(dict[str, float]):
    """Constants of `Tissue` that a command gives, by name; its options are made of the fields of `Tissue`."""


def parse_command(command: Any, arguments: Sequence[str]) -> Any:
    """The command of a class that the words after `warp-trunk`, its name first, ask for.

    `--help` shows the fields of the class itself and, of the dataclasses within it, those that its attribute
    `common` names, where it has one; `--help-all` shows all.

    Raises:
        InputError: arguments that do not fit.
        SystemExit: after the help that they ask for.
    """
    os.environ["COLUMNS"] = str(max(NARROWEST, shutil.get_terminal_size().columns))
    name, *words = arguments
    common = getattr(command, "common", None)
    all_shown = "--help" if common is None else "--help-all"
    prog = f"warp-trunk {name}"
    if not {"-h", "--help", "--help-all"}.isdisjoint(words):
        shown = None if "--help-all" in words else common
        if shown is not None:
            print(f"The options that are set most; warp-trunk {name} --help-all shows all of them.\n")
        tyro.cli(OmitArgPrefixes[command], args=["--help"], registry=_registry(command, shown), prog=prog)
    options_given = _options_given(command, words)
    said = io.StringIO()  # as it is no terminal, tyro draws neither boxes nor colours
    try:
        with redirect_stdout(said), redirect_stderr(said):
            parsed = tyro.cli(OmitArgPrefixes[command], args=words, registry=_registry(command), prog=prog)
        return replace(parsed, options_given=options_given) if hasattr(parsed, "options_given") else parsed
    except SystemExit as end:
        error: BaseException | None = end
        while error is not None and not isinstance(error, InputError):
            error = error.__context__
        line = error or f"{_message(said.getvalue())}; warp-trunk {name} {all_shown} lists the options"
        raise InputError(str(line)) from None


def _message(said: str) -> str:
    """The message of tyro between its title and the rule above its help, in one line."""
    parts: list[list[str]] = [[]]
    for row in said.splitlines():
        if not row.strip(" -"):  # a rule
            parts.append([])
        elif not row.startswith(" " * 9):  # the help of an option that is named
            parts[-1].extend(row.split())
    return "; ".join(" ".join(part) for part in parts[1:] if part and part[0] not in ("For", "Argument"))


def _options_given(command: Any, words: Sequence[str]) -> dict[str, str]:
    """The options among the words by their names in Python, and as they were written.

    Raises:
        InputError: one is given again, though it is none that may be repeated.
    """
    hints = get_type_hints(command, include_extras=True)
    options_given: dict[str, str] = {}
    for option in (word.partition("=")[0] for word in words if word.startswith("--")):
        name = option.removeprefix("--").replace("-", "_")
        if name in options_given and UseAppendAction not in getattr(hints.get(name), "__metadata__", ()):
            rule = "is given more than once, and only the last one would count"
            raise InputError(f"{option}: {rule}; give it once")
        options_given[name] = option
    return options_given


def _registry(command: Any, common: frozenset[str] | None = None) -> ConstructorRegistry:
    """How fields become options; without those that only Python has, and, where given, without the less common."""
    registry = ConstructorRegistry()
    registry.primitive_rule(_may_be_left_out)
    being_described: set[Any] = set()  # tyro is asked for the fields of a class from within the rule for it

    @registry.struct_rule
    def _fields(info: StructTypeInfo) -> StructConstructorSpec | None:
        if info.type is SomeConstants:
            return _some_constants(shown=common is None)
        if not is_dataclass(info.type) or info.type in being_described:
            return None
        being_described.add(info.type)
        spec = ConstructorRegistry.get_struct_spec(info)
        being_described.remove(info.type)
        if not isinstance(spec, StructConstructorSpec):
            return None
        fields = [replace(field, helptext=partial(_flowing, field.helptext)) for field in spec.fields]
        for place, field in enumerate(fields):
            rare = common is not None and info.type is not command and field.name not in common
            if field.name in ONLY_IN_PYTHON or (rare and not is_dataclass(field.type)):
                fields[place] = replace(field, type=Suppress[field.type])
        return replace(spec, fields=tuple(fields))

    return registry


def _some_constants(*, shown: bool) -> StructConstructorSpec:
    """An option for each constant of a tissue, which may be left out; shown in the help or not."""
    tissue = ConstructorRegistry.get_struct_spec(StructTypeInfo.make(Tissue, set(), in_union_context=False))
    assert isinstance(tissue, StructConstructorSpec)
    kind: Any = float | None if shown else Suppress[float | None]
    return StructConstructorSpec(
        instantiate=lambda **values: SomeConstants({name: x for name, x in values.items() if x is not None}),
        fields=tuple(
            replace(field, type=kind, default=None, helptext=partial(_flowing, field.helptext))
            for field in tissue.fields
        ),
    )


def _flowing(text: str | Callable[[], str | None] | None) -> str | None:
    """A help text as one paragraph; tyro keeps the line breaks of some docstrings."""
    flowing = text() if callable(text) else text
    return flowing and " ".join(flowing.split())


def _may_be_left_out(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """A value or nothing is asked for as the value: `None` is no word for a command line."""
    kinds = get_args(info.type)
    if NoneType not in kinds or len(kinds) != 2:
        return None
    (kind,) = (kind for kind in kinds if kind is not NoneType)
    spec = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kind, info.markers))
    if not isinstance(spec, PrimitiveConstructorSpec):
        return None
    return replace(
        spec,
        is_instance=lambda value: value is None or spec.is_instance(value),
        str_from_instance=lambda value: ["unset"] if value is None else spec.str_from_instance(value),
    )
