"""case.toml: the name of a case, the units and axes of its files, and its tissues."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError

from .axes import MILLIMETRES, Axes
from .keys import changed, check_table, names_of, numbers, read_toml, table_lines, toml
from .landmarks import COLUMNS
from .layers import LayerTable, layer_lines, layer_table
from .rib_shares import RibShares
from .study import KINDS as STUDY_KINDS
from .study import Study
from .uncertainty import Uncertainty

POSTURES = ("standing", "supine", "prone")
"""Postures during the scan."""


@dataclass(frozen=True)
class CaseHeader:
    """The contents of case.toml; every key is optional."""

    name: str
    """Name of the case; that of its folder if not given."""
    units: str = "mm"
    """Unit of every length in the folder: mm, cm or m."""
    axes: Axes = dataclasses.field(default_factory=lambda: Axes("LPS"))
    """Patient axes of every position in the folder."""
    landmark_columns: tuple[str, ...] = COLUMNS
    """Columns of the CSV files of landmarks that hold name, x, y and z."""
    posture: str = "standing"
    """Posture during the scan, one of `POSTURES`."""
    tissue: Tissue = dataclasses.field(default_factory=Tissue)
    """Constants of the soft tissue, from the table [tissue]."""
    layers: LayerTable | None = None
    """Skin, fat and muscle, from the table [layers]."""
    ribs: RibShares = dataclasses.field(default_factory=RibShares)
    """How ribs follow the spine, from the table [ribs]."""
    uncertainty: Uncertainty = dataclasses.field(default_factory=Uncertainty)
    """Uncertainty of the case, from the table [uncertainty]."""
    study: Study = dataclasses.field(default_factory=Study)
    """Data for a study of several cases, from the table [study]."""


_RECORDS = {"tissue": Tissue, "ribs": RibShares, "uncertainty": Uncertainty}
"""The tables that hold numbers only."""
_KINDS = {
    **dict.fromkeys(("name", "units", "axes", "posture"), "text"),
    "landmark_columns": "a list of four column names",
}
"""The kind of each value of case.toml; all others are tables."""


def read_header(path: Path) -> CaseHeader:
    """Read case.toml.

    Raises:
        InputError: a missing or unreadable file, an unknown key (the nearest known one is named), a value of
            the wrong type or one that is not allowed.
    """
    table = read_toml(path, "a case needs this file, which may be empty")
    table.pop("skin_after_is_placeholder", None)  # version 0.1 wrote it
    check_table(path, table, {name: _KINDS.get(name, "a table") for name in names_of(CaseHeader)})
    values: dict[str, Any] = {"name": path.resolve().parent.name, **table}
    for key, allowed, what in (
        ("units", MILLIMETRES, "the unit of the surfaces and landmarks"),
        ("posture", POSTURES, "the posture during the scan"),
    ):
        if key in table and table[key] not in allowed:
            raise InputError(
                f"{path}: '{key}' must be one of {', '.join(allowed)}, not '{table[key]}'; write {what}"
            )
    if "landmark_columns" in table:
        values["landmark_columns"] = _columns(path, table["landmark_columns"])
    try:
        if "axes" in table:
            values["axes"] = Axes(table["axes"])
        for key, record in _RECORDS.items():
            if key in table:
                values[key] = record(**numbers(path, table[key], names_of(record), f"{key}."))
        if "layers" in table:
            values["layers"] = layer_table(path, table["layers"])
        if "study" in table:
            check_table(path, table["study"], STUDY_KINDS, "study.")
            values["study"] = Study(**table["study"])
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    return CaseHeader(**values)


def _columns(path: Path, names: list[Any]) -> tuple[str, ...]:
    if (
        len(names) != 4
        or len({*map(str, names)}) != 4
        or not all(isinstance(name, str) and name for name in names)
    ):
        raise InputError(
            f"{path}: 'landmark_columns' must be four different names of columns, those of name, x, y and z, "
            f"not {str(names)[:60]}; correct it"
        )
    return tuple(names)


def header_text(header: CaseHeader) -> str:
    """The text of case.toml, which `read_header` reads back to the last bit."""
    lines = [
        f"name = {toml(header.name)}",
        f'units = "{header.units}"',
        f'axes = "{header.axes.code}"  # the patient\'s left, back and up are L, P and S',
        f'posture = "{header.posture}"',
        *table_lines("tissue", dataclasses.asdict(header.tissue)),
        *table_lines("ribs", changed(header.ribs)),
        *table_lines("uncertainty", changed(header.uncertainty)),
        *table_lines("study", changed(header.study)),
        *([] if header.layers is None else layer_lines(header.layers)),
    ]
    return "\n".join(lines) + "\n"
