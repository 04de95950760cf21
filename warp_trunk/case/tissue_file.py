"""Constants of tissue and ribs by one name each, and the file that holds them for many cases: tissue.toml."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from warp_trunk.engine.tissue import TISSUE_LIMITS, Tissue
from warp_trunk.errors import InputError, closest_name
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.records import as_record, read_toml, toml_text

from .case import Case
from .layers import NAMES, LayerConstants, Layers, check_constants
from .rib_coupling import RibCoupling

RIBS = "ribs"
_OF_RIBS = tuple(share.name for share in dataclasses.fields(RibCoupling))
CONSTANT_NAMES = (
    *TISSUE_LIMITS,
    *(f"{layer}.{name}" for layer in NAMES for name in TISSUE_LIMITS),
    *(f"{RIBS}.{name}" for name in _OF_RIBS),
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


def check_named(constants: Mapping[str, float]) -> None:
    """InputError for a constant that there is not, or for a value that it cannot have."""
    for name in constants:
        if name not in CONSTANT_NAMES:
            hint = closest_name(name, CONSTANT_NAMES)
            raise InputError(f"there is no constant '{name}'{hint}; known are {', '.join(CONSTANT_NAMES)}")
    tables = _by_table(constants)
    RibCoupling(**tables.pop(RIBS, {}))
    for table in tables.values():
        Tissue(**table)


def with_constants(case: Case, constants: Mapping[str, float]) -> Case:
    """The case with other constants; one of a layer makes a case that says nothing of layers have them.

    Raises:
        InputError: a value that a constant cannot have.
    """
    tables = _by_table(constants)
    shares = dataclasses.replace(case.rib_coupling, **tables.pop(RIBS, {}))
    tissue = dataclasses.replace(case.tissue, **tables.pop("", {}))
    layers = case.layers
    if tables:
        layers = layers or Layers()
        own = {name: {**layers.constants.get(name, {}), **tables.get(name, {})} for name in NAMES}
        layers = dataclasses.replace(layers, constants={name: values for name, values in own.items() if values})
        layers.tissues(tissue)  # checks the values
    return dataclasses.replace(case, tissue=tissue, rib_coupling=shares, layers=layers)


def _by_table(constants: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Constants by the layer or the ribs that they are of, "" for the uniform tissue."""
    tables: dict[str, dict[str, float]] = {}
    for name, value in constants.items():
        of, _, constant = name.rpartition(".")
        tables.setdefault(of, {})[constant] = float(value)
    return tables


@dataclasses.dataclass(frozen=True, kw_only=True)
class _TissueFile:
    """Tables of case.toml, of which a file gives some."""

    tissue: dict[str, float] = dataclasses.field(default_factory=dict)
    layers: LayerConstants = dataclasses.field(default_factory=LayerConstants)
    ribs: RibCoupling = dataclasses.field(default_factory=RibCoupling)

    def __post_init__(self) -> None:
        """Raises InputError for what is no constant of a tissue."""
        check_constants(self.tissue, "tissue")


def read_tissue_file(path: Path) -> dict[str, float]:
    """The constants that a tissue.toml gives, by their names in `CONSTANT_NAMES`.

    Its tables are those of case.toml: [tissue], [layers.skin], [layers.fat], [layers.muscle] and [ribs].

    Raises:
        InputError: a missing or unreadable file, an unknown key, or a value that is not a number or not allowed.
    """
    table = read_toml(path, "give a file that `calibrate` wrote")
    file = as_record(table, _TissueFile, path)
    of_layers = file.layers.constants
    return (
        file.tissue
        | {f"{layer}.{name}": value for layer, constants in of_layers.items() for name, value in constants.items()}
        | {f"{RIBS}.{name}": getattr(file.ribs, name) for name in table.get(RIBS, ())}
    )


def write_tissue_file(path: Path, constants: Mapping[str, float], remarks: Sequence[str] = ()) -> None:
    """Write constants under lines of remarks, so that `read_tissue_file` reads them back to the last bit."""
    tables = _by_table({name: constants[name] for name in sorted(constants, key=CONSTANT_NAMES.index)})
    layers = {name: tables[name] for name in NAMES if name in tables}
    record = {"tissue": tables.get("", {}), "layers": layers, RIBS: tables.get(RIBS, {})}
    write_whole(path, toml_text(record, remarks))
