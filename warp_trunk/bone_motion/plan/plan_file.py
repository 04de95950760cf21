"""plan.toml: reading and writing a plan."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

from warp_trunk.case.keys import is_number, refuse_unknown, shown
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.file_access import number, read_text

from .record import CurvePlan, Plan

_MOST = 1_000_000
"""No plan.toml is longer than this [bytes]."""
WORDS = ("apex", "uiv", "liv", "unfused", "balance")
"""Keys whose values are text; all others are numbers."""


def read_plan(path: str | Path) -> Plan:
    """Read a plan.toml.

    >>> wt.write_plan(folder / "plan.toml", wt.Plan(uiv="T4", liv="L1"))
    >>> wt.read_plan(folder / "plan.toml").liv
    'L1'

    Raises:
        InputError: a missing or unreadable file, an unknown key (the nearest known one is named), a value of the
            wrong type or one that is not allowed.
    """
    path = Path(path)
    text = read_text(path, "a plan is given as TOML; see docs/planning.md", _MOST)
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({error}); correct it there") from error
    curves = table.pop("curve", [])
    if not (isinstance(curves, list) and all(isinstance(curve, dict) for curve in curves)):
        raise InputError(f"{path}: 'curve' must be tables, [[curve]] before each; correct it")
    try:
        refuse_unknown(path, table, [*_keys(Plan)[:-1], "curve"], "")
        _check_values(table)
        for key in ("uiv", "liv"):
            if key not in table:
                raise InputError(f"'{key}' is missing; a plan says which levels are fused, so add it")
        return Plan(**table, curves=tuple(_curve(path, curve) for curve in curves))
    except InputError as error:
        said = str(error)
        raise InputError(said if said.startswith(str(path)) else f"{path}: {said}") from None


def _curve(path: Path, table: dict[str, Any]) -> CurvePlan:
    refuse_unknown(path, table, _keys(CurvePlan), "curve.")
    _check_values(table)
    if "apex" not in table:
        raise InputError("a curve has no 'apex'; name its apical vertebra")
    return CurvePlan(**table)


def curve_of_text(text: str) -> CurvePlan:
    """One curve as the command line has it: T8,correction=0.65,derotation=0.4.

    Raises:
        InputError: a key that is not known, or a value that is no number or is not allowed.
    """
    apex, *parts = (part.strip() for part in text.split(","))
    table: dict[str, Any] = {"apex": apex}
    for part in parts:
        key, _, value = part.partition("=")
        try:
            table[key.strip()] = number(value)
        except ValueError:
            raise InputError(
                f"--curve {text}: '{part}' must be a name, = and a number, as correction=0.65"
            ) from None
    return _curve(Path("--curve"), table)


def _keys(record: type) -> list[str]:
    """Names of the fields, that of the curves last."""
    return sorted((field.name for field in dataclasses.fields(record)), key=lambda name: name == "curves")


def _check_values(table: dict[str, Any]) -> None:
    for key, value in table.items():
        if not (isinstance(value, str) if key in WORDS else is_number(value)):
            raise InputError(
                f"'{key}' must be {'text' if key in WORDS else 'a number'}, not {shown(value)}; correct it"
            )


def plan_text(plan: Plan) -> str:
    """The text of a plan.toml that `read_plan` reads back to the last bit."""
    tables = [("", {name: getattr(plan, name) for name in _keys(Plan)[:-1]})]
    tables += [("\n[[curve]]\n", dataclasses.asdict(curve)) for curve in plan.curves]
    return "".join(
        head + "".join(f"{key} = {_value(value)}\n" for key, value in table.items() if value is not None)
        for head, table in tables
    )


def _value(value: str | float) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(float(value))


def write_plan(path: str | Path, plan: Plan) -> None:
    """Write a plan.toml.

    >>> wt.write_plan(folder / "fused.toml", wt.Plan(uiv="T4", liv="L1"))
    """
    with atomic_write(Path(path)) as unfinished:
        unfinished.write_text(plan_text(plan), encoding="utf-8")
