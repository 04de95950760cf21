"""case.toml: the name of a case, the units and axes of its files, and its tissues."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import partial
from warp_trunk.io.surface_files import in_lps, read_stated

from .axes import MILLIMETRES, Axes
from .invented import Invented
from .keys import changed, converted, read_toml, refuse_unknown, table_lines, toml, with_present_keys
from .landmarks import COLUMNS
from .layers import LayerTable, layer_lines
from .rib_coupling import FORMER_RIBS, RibCoupling
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
    """Unit of every length in the folder: mm, cm, m or in (inches)."""
    axes: Axes = dataclasses.field(default_factory=lambda: Axes("LPS"))
    """Patient axes of every position in the folder."""
    landmark_columns: tuple[str, ...] = COLUMNS
    """Columns of the CSV files of landmarks that hold name, x, y and z."""
    posture: str = "standing"
    """Posture during the scan, one of `POSTURES`."""
    notes: tuple[str, ...] = ()
    """Doubts of the image that the case was made from, a sentence each."""
    tissue: Tissue = dataclasses.field(default_factory=Tissue)
    """Constants of the soft tissue, from the table [tissue]."""
    layers: LayerTable | None = None
    """Skin, fat and muscle, from the table [layers]."""
    ribs: RibCoupling = dataclasses.field(default_factory=RibCoupling)
    """How ribs follow the spine, from the table [ribs]."""
    uncertainty: Uncertainty = dataclasses.field(default_factory=Uncertainty)
    """Uncertainty of the case, from the table [uncertainty]."""
    study: Study = dataclasses.field(default_factory=Study)
    """Data for a study of several cases, from the table [study]."""
    invented: Invented | None = None
    """The parts that were not measured, from the table [invented]."""

    def surface(self, path: Path) -> tuple[Surface, str | None]:
        """A surface of the folder in LPS [mm], and a sentence where its header states other axes than are used.

        Axes other than LPS in case.toml hold for all files; else the header of a file does.
        """
        surface, space = read_stated(path)
        if self.axes.code == "LPS":
            return self.axes.surface_to_lps(in_lps(surface, space), self.units), None
        note = f'{path}: its header says SPACE={space}; axes = "{self.axes.code}" of case.toml is used.'
        differs = space not in (None, self.axes.code)
        return self.axes.surface_to_lps(surface, self.units), note if differs else None


_KINDS = {
    **dict.fromkeys(("name", "units", "axes", "posture"), str),
    "landmark_columns": tuple[str, str, str, str],
    "notes": tuple[str, ...],
    "tissue": Tissue,
    "layers": LayerTable,
    "ribs": RibCoupling,
    "uncertainty": Uncertainty,
    "study": Study,
    "invented": Invented,
}
"""The type of each value of case.toml."""


def read_header(path: Path) -> CaseHeader:
    """Read case.toml, which may be missing.

    Raises:
        InputError: an unreadable file, one that was not written to its end, an unknown key (the nearest known one
            is named), a value of the wrong type or one that is not allowed.
    """
    table: dict[str, Any] = {}
    if path.exists() or path.is_symlink():
        table = read_toml(path, "the header of a case was expected")
    elif partial(path).exists():
        raise InputError(f"{path}: is missing, as writing this case did not end; write the case again")
    refuse_unknown(path, table, list(_KINDS), "")
    for name, former in (("ribs", FORMER_RIBS), ("study", {"virtual": "synthetic"})):
        if name in table:
            table[name] = with_present_keys(table[name], former)
    values: dict[str, Any] = {"name": path.resolve().parent.name}
    values |= {key: converted(path, value, _KINDS[key], key) for key, value in table.items()}
    for key, allowed in (("units", MILLIMETRES), ("posture", POSTURES)):
        if key in values and values[key] not in allowed:
            raise InputError(f"{path}: '{key}' must be {' or '.join(allowed)}, not '{values[key]}'; correct it")
    columns = values.get("landmark_columns", COLUMNS)
    if len({*columns, ""}) != 5:
        raise InputError(f"{path}: 'landmark_columns' must be four different names, not {columns}; correct it")
    try:
        if "layers" in values:
            values["layers"].check(path)
        return CaseHeader(**{**values, "axes": Axes(values.get("axes", "LPS"))})
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def header_text(header: CaseHeader) -> str:
    """The text of case.toml, which `read_header` reads back to the last bit."""
    lines = [
        f"name = {toml(header.name)}",
        f'units = "{header.units}"',
        f'axes = "{header.axes.code}"  # the patient\'s left, back and up are L, P and S',
        f'posture = "{header.posture}"',
        *([f"notes = {toml(header.notes)}"] if header.notes else []),
        *table_lines("tissue", dataclasses.asdict(header.tissue)),
        *table_lines("ribs", changed(header.ribs)),
        *table_lines("uncertainty", changed(header.uncertainty)),
        *table_lines("study", changed(header.study)),
        *table_lines("invented", {} if header.invented is None else dataclasses.asdict(header.invented)),
        *([] if header.layers is None else layer_lines(header.layers)),
    ]
    return "\n".join(lines) + "\n"
