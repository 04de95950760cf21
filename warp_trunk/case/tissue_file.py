"""Constants of tissue and ribs by one name each, and the file that holds them for many cases: tissue.toml."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warp_trunk.engine.tissue import Tissue
from warp_trunk.io.atomic_write import write_whole

from .keys import converted, names_of, read_toml, refuse_unknown, table_lines, with_present_keys
from .layers import NAMES, Layers
from .rib_coupling import FORMER_RIBS, RibCoupling

if TYPE_CHECKING:
    from .case import Case

RIBS = "ribs"
CONSTANT_NAMES = (
    *names_of(Tissue),
    *(f"{layer}.{name}" for layer in NAMES for name in names_of(Tissue)),
    *(f"{RIBS}.{name}" for name in names_of(RibCoupling)),
)
"""Every constant: of the uniform tissue (`poisson_ratio`; of layers too, where they give none of their own), of a
layer (`fat.youngs_modulus`), and the shares of the ribs (`ribs.reversible_part`)."""


def constant_of(case: Case, name: str) -> float:
    """The value of a constant in a case, given there or by default."""
    of, _, constant = name.rpartition(".")
    if of == RIBS:
        return float(getattr(case.rib_coupling, constant))
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
    shares = dataclasses.replace(case.rib_coupling, **tables.pop(RIBS, {}))
    tissue = dataclasses.replace(case.tissue, **tables.pop("", {}))
    layers = case.layers
    if tables:
        layers = layers or Layers()
        given = {name: {**layers.constants.get(name, {}), **tables.get(name, {})} for name in NAMES}
        layers = dataclasses.replace(layers, constants={name: values for name, values in given.items() if values})
        layers.tissues(tissue)  # checks the values
    return dataclasses.replace(case, tissue=tissue, rib_coupling=shares, layers=layers)


def read_tissue_file(path: Path) -> dict[str, float]:
    """The constants that a tissue.toml gives, by their names in `CONSTANT_NAMES`.

    Its tables are those of case.toml: [tissue], [layers.skin], [layers.fat], [layers.muscle] and [ribs].

    Raises:
        InputError: a missing or unreadable file, an unknown key, or a value that is not a number or not allowed.
    """
    table = read_toml(path, "give a file that `calibrate` wrote")
    refuse_unknown(path, table, ["tissue", "layers", RIBS], "")
    if RIBS in table:
        table[RIBS] = with_present_keys(table[RIBS], FORMER_RIBS)
    layers = converted(path, table.pop("layers", {}), dict[str, Any], "layers")
    refuse_unknown(path, layers, list(NAMES), "layers.")
    found = {}
    for name, values in (*table.items(), *((f"layers.{name}", values) for name, values in layers.items())):
        checked = converted(path, values, RibCoupling if name == RIBS else Tissue, name)
        prefix = f"{name}.".removeprefix("tissue.").removeprefix("layers.")
        found |= {f"{prefix}{constant}": float(getattr(checked, constant)) for constant in values}
    return found


def write_tissue_file(path: Path, constants: Mapping[str, float], remarks: Sequence[str] = ()) -> None:
    """Write constants under lines of remarks, so that `read_tissue_file` reads them back to the last bit."""
    tables: dict[str, dict[str, float]] = {}
    for name in CONSTANT_NAMES:
        if name in constants:
            of, _, constant = name.rpartition(".")
            table = "tissue" if not of else RIBS if of == RIBS else f"layers.{of}"
            tables.setdefault(table, {})[constant] = constants[name]
    lines = [f"# {remark}" for remark in remarks]
    for table, values in tables.items():
        lines += table_lines(table, values)
    write_whole(path, "\n".join(lines) + "\n")
