"""Records in files of TOML and JSON: one strict reader, one writer of TOML, and one line for what does not fit."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from warp_trunk.errors import InputError, closest_name, within

from .file_access import read_text

Record = TypeVar("Record")
_NO_NUMBER = re.compile(
    r"(?<=[:\[, \n])[-+]?(?:nan|inf(?:inity)?|1\.#\w+)(?:\(\w*\))?(?=\s*[,}\]])", re.IGNORECASE
)
_MOST_BYTES = 1_000_000
"""No file of TOML is longer than this [bytes]."""
_IN_WORDS = {
    "object": "a table", "array": "a list", "float": "a number", "int": "a whole number", "str": "a text",
    "bool": "true or false", "null": "null",
}  # fmt: skip
"""msgspec's names of types, as messages have them."""


def read_toml(path: Path, expected: str) -> dict[str, Any]:
    """The table of a TOML file; InputError, with what was expected, for a file that is missing or unreadable."""
    return toml_table(read_text(path, expected, _MOST_BYTES), path)


def toml_table(text: str, path: Path) -> dict[str, Any]:
    """The table of a text in TOML; InputError, with the path that it is of, where it cannot be read."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({error}); correct it there") from error


def as_record(table: dict[str, Any], kind: type[Record], where: Path | str) -> Record:
    """A table as a dataclass or a Struct, whose fields are the keys and whose types say what each may be.

    Its `file_keys` has the keys of fields that a file names otherwise; they are renamed in the table.

    Args:
        table: of plain values.
        kind: the class of the record.
        where: the file, or the option of the command line, with which a message begins.

    Raises:
        InputError: an unknown key, a value of another type or out of its bounds, or one that the record refuses.
    """
    _check_keys(table, msgspec.inspect.type_info(kind), where, "")
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {_fault(error, table, getattr(kind, 'file_keys', {}))}") from error


def read_json(path: Path, kind: type[Record], expected: str, fault: str, cure: str) -> Record:
    """The record of a JSON file, whose further keys are passed over.

    Raises:
        InputError: a missing file, with what was `expected`, or one that is none, with its `fault` and the `cure`.
    """
    text = _NO_NUMBER.sub("null", read_text(path, expected))  # which JSON does not have, and programs write
    try:
        return msgspec.json.decode(text, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise InputError(f"{path}: {fault} ({error}); {cure}") from error


def _check_keys(value: Any, kind: Any, where: Path | str, prefix: str) -> None:
    """InputError for an unknown key at any depth and for a word that is not known, each with the nearest."""
    for option in getattr(kind, "types", (kind,)):
        words = getattr(option, "values", ())  # of a Literal
        if words and isinstance(value, str) and value not in words:
            rule = f"must be {' or '.join(words)}, not {value!r}{closest_name(value, words)}"
            raise InputError(f"{where}: '{prefix}' {rule}; give one of them")
        if isinstance(value, list) and hasattr(option, "item_type"):
            for row in value:
                _check_keys(row, option.item_type, where, prefix)
        fields = {field.encode_name: field.type for field in getattr(option, "fields", ())}
        if not fields or not isinstance(value, dict):
            continue
        file_keys = getattr(option.cls, "file_keys", {})
        fields |= {key: fields.pop(name) for name, key in file_keys.items()}
        start = f"{prefix}." if prefix else ""
        for key, inner in value.items():
            if key not in fields:
                hint = closest_name(key, fields).replace("mean '", f"mean '{start}")
                keys = ", ".join(start + name for name in fields)
                raise InputError(f"{where}: unknown key '{start}{key}'{hint}; the keys are {keys}")
            _check_keys(inner, fields[key], where, start + key)
        for name, key in file_keys.items():
            if key in value:
                value[name] = value.pop(key)


def _fault(error: msgspec.ValidationError, table: Any, file_keys: Mapping[str, str]) -> str:
    """The key, the rule and the value found; what a record itself refuses is said in its own words."""
    if isinstance(error.__cause__, InputError):
        return str(error.__cause__)
    rule, _, place = str(error).removesuffix("`").partition(" - at `$")
    place = place.removeprefix(".")
    name = re.sub(r"^\w+", lambda field: file_keys.get(field[0], field[0]), place)
    name = f"'{name}' " if name else ""
    value: Any = table
    for key in re.findall(r"[^.\[\]]+", place):
        value = value[int(key)] if isinstance(value, list) else value.get(key) if isinstance(value, dict) else None
    if lacking := re.search("missing required field `(.*)`", rule):
        return f"{name}lacks '{lacking[1]}'; add it"
    if not rule.startswith("Expected"):
        return f"{name}has the fault: {rule}; correct it"
    wanted = rule.removeprefix("Expected ").partition(", got")[0].replace("`", "").replace(" | null", "")
    wanted = re.sub(r"[a-z]+", lambda word: _IN_WORDS.get(word[0], word[0]), wanted.replace(" | ", " or "))
    bound = re.search(r"[<>]= (\S+)$", wanted)
    cure = within(value, float(bound[1])) if bound and not math.isnan(value) else "; correct it"
    return f"{name}must be {wanted}, not {shown(value)}{cure}"


def shown(value: object) -> str:
    """A value as messages show it."""
    return f"{value[:40]!r}" if isinstance(value, str) else f"{value}"[:60]


def toml_text(record: Mapping[str, Any], remarks: Sequence[str] = ()) -> str:
    """The text of a TOML file under lines of remarks: values first, then tables, whose own tables are inline.

    Numbers come back to the last bit; what is None or empty is left out.
    """
    lines, tables = [f"# {remark}" for remark in remarks], []
    for key, value in record.items():
        if isinstance(value, Mapping):
            tables += [(f"[{_key(key)}]", value)] if value else []
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            tables += [(f"[[{_key(key)}]]", table) for table in value]
        elif value is not None and value != ():
            lines.append(f"{_key(key)} = {_toml(value)}")
    for head, table in tables:
        lines += [
            "",
            head,
            *(f"{_key(key)} = {_toml(value)}" for key, value in table.items() if value is not None),
        ]
    return "\n".join(lines).lstrip("\n") + "\n" if lines else ""


def _key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else _toml(key)


def _toml(value: Any) -> str:
    """The TOML text of a value; JSON's escapes are TOML's, except for DEL."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(float(value))
