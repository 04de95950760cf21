"""Constants of tissue and ribs by one name each, and the file that holds them for many cases: tissue.toml."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.file_access import read_text

from .keys import numbers, refuse_unknown, shown
from .layers import NAMES, Layers
from .rib_shares import RibShares

if TYPE_CHECKING:
    from .case import Case

RIBS = "ribs"
_TISSUE = [field.name for field in dataclasses.fields(Tissue)]
_SHARES = [field.name for field in dataclasses.fields(RibShares)]
CONSTANT_NAMES = (
    *_TISSUE,
    *(f"{layer}.{name}" for layer in NAMES for name in _TISSUE),
    *(f"{RIBS}.{name}" for name in _SHARES),
)
"""Every constant: of the uniform tissue (`poisson_ratio`; of layers too, where they give none of their own), of a
layer (`fat.youngs_modulus`), and the shares of the ribs (`ribs.recovery`)."""
_MOST = 100_000
"""No tissue.toml is longer than this [bytes]."""


def constant_of(case: Case, name: str) -> float:
    """The value of a constant in a case, given there or by default."""
    of, _, constant = name.rpartition(".")
    if of == RIBS:
        return float(getattr(case.rib_shares, constant))
    if of:
        layers = case.layers or Layers()
        return float(getattr(layers.tissues(case.tissue)[NAMES.index(of)], constant))
    return float(getattr(case.tissue, constant))


def with_constants(case: Case, constants: Mapping[str, float]) -> Case:
    """The case with other constants; one of a layer makes a case that says nothing of layers have them.

    Raises:
        InputError: a value that a constant cannot have.
    """
    tables: dict[str, dict[str, float]] = {}
    for name, value in constants.items():
        of, _, constant = name.rpartition(".")
        tables.setdefault(of, {})[constant] = float(value)
    shares = dataclasses.replace(case.rib_shares, **tables.pop(RIBS, {}))
    tissue = dataclasses.replace(case.tissue, **tables.pop("", {}))
    layers = case.layers
    if tables:
        layers = layers or Layers()
        given = {name: {**layers.constants.get(name, {}), **tables.get(name, {})} for name in NAMES}
        layers = dataclasses.replace(layers, constants={name: values for name, values in given.items() if values})
        layers.tissues(tissue)  # checks the values
    return dataclasses.replace(case, tissue=tissue, rib_shares=shares, layers=layers)


def read_tissue_file(path: Path) -> dict[str, float]:
    """The constants that a tissue.toml gives, by their names in `CONSTANT_NAMES`.

    Its tables are those of case.toml: [tissue], [layers.skin], [layers.fat], [layers.muscle] and [ribs].

    Raises:
        InputError: a missing or unreadable file, an unknown key, or a value that is no number or cannot be.
    """
    text = read_text(path, "give a file that `calibrate` wrote", _MOST)
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({error}); correct it there") from error
    refuse_unknown(path, table, ["tissue", "layers", RIBS], "")
    layers = _table(path, table, "layers")
    refuse_unknown(path, layers, list(NAMES), "layers.")
    found = numbers(path, _table(path, table, "tissue"), _TISSUE, "tissue.")
    for layer in layers:
        given = numbers(path, _table(path, layers, layer, "layers."), _TISSUE, f"layers.{layer}.")
        found |= {f"{layer}.{name}": value for name, value in given.items()}
    shares = numbers(path, _table(path, table, RIBS), _SHARES, "ribs.")
    found |= {f"{RIBS}.{name}": value for name, value in shares.items()}
    try:
        _check(found)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return found


def write_tissue_file(path: Path, constants: Mapping[str, float], remarks: Sequence[str] = ()) -> None:
    """Writes constants as `read_tissue_file` reads them back to the last bit, under lines of remarks."""
    tables: dict[str, list[str]] = {}
    for name in CONSTANT_NAMES:
        if name in constants:
            of, _, constant = name.rpartition(".")
            table = "tissue" if not of else RIBS if of == RIBS else f"layers.{of}"
            tables.setdefault(table, []).append(f"{constant} = {float(constants[name])!r}")
    lines = [f"# {remark}" for remark in remarks]
    for table, values in tables.items():
        lines += ["", f"[{table}]", *values]
    with atomic_write(path) as unfinished:
        unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _table(path: Path, table: Mapping[str, Any], name: str, prefix: str = "") -> dict[str, Any]:
    found = table.get(name, {})
    if not isinstance(found, dict):
        raise InputError(
            f"{path}: '{prefix}{name}' must be a table, [{prefix}{name}], not {shown(found)}; correct it"
        )
    return found


def _check(constants: Mapping[str, float]) -> None:
    """Raises InputError for a value that its constant cannot have."""
    for name, value in constants.items():
        of, _, constant = name.rpartition(".")
        kind = RibShares if of == RIBS else Tissue
        kind(**{constant: value})
