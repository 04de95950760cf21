"""TOML: reading a file and its tables, and writing values."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from warp_trunk.errors import InputError, nearest
from warp_trunk.io.file_access import read_text

_MOST = 1_000_000
"""No file is longer than this [bytes]."""


def read_toml(path: Path, expected: str) -> dict[str, Any]:
    """The table of a TOML file; InputError, with what was expected, for a file that is missing or unreadable."""
    return toml_table(read_text(path, expected, _MOST), path)


def toml_table(text: str, path: Path) -> dict[str, Any]:
    """The table of a text in TOML; InputError, with the path that it is of, where it cannot be read."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({error}); correct it there") from error


def converted(path: Path, value: object, kind: Any, name: str) -> Any:
    """A value of a TOML file as a type, a table as a dataclass.

    Raises:
        InputError: an unknown key, a value of another type, or one that the dataclass does not allow.
    """
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        if not isinstance(value, dict):
            raise InputError(f"{path}: '{name}' must be a table, [{name}], not {shown(value)}; correct it")
        refuse_unknown(path, value, names_of(kind), f"{name}.")
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: '{name}': {error}; docs/case.md lists what each key may be") from error


def refuse_unknown(path: Path, table: Iterable[str], known: list[str], prefix: str) -> None:
    """InputError for an unknown key, with the nearest known one."""
    for key in table:
        if key not in known:
            keys = [prefix + name for name in known]
            hint = nearest(key, known).replace("mean '", f"mean '{prefix}")
            raise InputError(f"{path}: unknown key '{prefix}{key}'{hint}; the keys are {', '.join(keys)}")


def with_present_keys(table: object, former: Mapping[str, str]) -> object:
    """A table of a file whose keys may be former ones, by their present names; both names of one key are not."""
    if not isinstance(table, dict):
        return table
    return {key if former.get(key) in table else former.get(key, key): value for key, value in table.items()}


def names_of(record: Any) -> list[str]:
    """The names of the fields of a dataclass."""
    return [field.name for field in dataclasses.fields(record)]


def shown(value: object) -> str:
    """A value as messages show it."""
    return f"{str(value)[:40]!r} ({type(value).__name__})" if isinstance(value, str) else f"{value}"[:60]


def toml(value: Any) -> str:
    """The TOML text of a value; JSON's escapes are TOML's, except for DEL."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{toml(key)} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(float(value))


def table_lines(name: str, table: Mapping[str, Any]) -> list[str]:
    """The lines of a table of a TOML file, after an empty one; none for an empty table."""
    return ["", f"[{name}]", *(f"{key} = {toml(value)}" for key, value in table.items())] if table else []


def changed(record: Any) -> dict[str, Any]:
    """The fields of a dataclass that differ from their defaults."""
    values = {field.name: (getattr(record, field.name), field.default) for field in dataclasses.fields(record)}
    return {name: value for name, (value, default) in values.items() if value != default}
