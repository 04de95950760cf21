"""case.toml: the name of a case, the units and axes of its files, and its tissues."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import partial
from warp_trunk.io.file_names import name_of
from warp_trunk.io.records import as_record, read_toml, toml_text
from warp_trunk.io.surface_files import in_lps, read_stated

from .axes import MILLIMETRES, Axes
from .case import Posture, Study
from .landmarks import COLUMNS
from .layers import LayerTable
from .rib_coupling import RibCoupling
from .uncertainty import Invented, Uncertainty


@dataclass(frozen=True)
class CaseHeader:
    """The contents of case.toml; every key is optional."""

    name: str
    """Name of the case; that of its folder if not given."""
    units: Literal["mm", "cm", "m", "in"] = "mm"
    """Unit of every length in the folder; `in` is inches."""
    axes: str = "LPS"
    """Code of the patient axes of every position in the folder, see `Axes`."""
    landmark_columns: tuple[str, str, str, str] = COLUMNS
    """Columns of the CSV files of landmarks that hold name, x, y and z."""
    posture: Posture = "standing"
    """Posture during the scan."""
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

    def __post_init__(self) -> None:
        """Raises InputError for axes that are none, and for a column that is named twice or not at all."""
        _ = self.frame
        if len({*self.landmark_columns, ""}) != 5:
            columns = list(self.landmark_columns)
            raise InputError(f"'landmark_columns' must be four different names, not {columns}; correct it")

    @cached_property
    def frame(self) -> Axes:
        """The axes."""
        return Axes(self.axes)

    def surface(self, path: Path) -> tuple[Surface, str | None]:
        """A surface of the folder in LPS [mm], and a sentence where its header states other axes than are used.

        Axes other than LPS in case.toml hold for all files; else the header of a file does.
        """
        surface, space = read_stated(path, MILLIMETRES[self.units])
        if self.axes == "LPS":
            return self.frame.surface_to_lps(in_lps(surface, space), self.units), None
        note = f'{path}: its header says SPACE={space}; axes = "{self.axes}" of case.toml is used.'
        return self.frame.surface_to_lps(surface, self.units), note if space not in (None, self.axes) else None


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
    return as_record({"name": name_of(path.resolve().parent)} | table, CaseHeader, path)


def header_text(header: CaseHeader) -> str:
    """The text of case.toml, which `read_header` reads back to the last bit; tables but [tissue] as they differ
    from their defaults."""
    record: dict[str, Any] = {field.name: getattr(header, field.name) for field in dataclasses.fields(header)}
    record |= {name: _changed(record[name]) for name in ("ribs", "uncertainty", "study")}
    for name in ("tissue", "invented"):
        record[name] = None if record[name] is None else dataclasses.asdict(record[name])
    record["layers"] = None if header.layers is None else header.layers.entries
    return toml_text(record, ["axes: the patient's left, back and up are L, P and S"])


def _changed(record: Any) -> dict[str, Any]:
    """The fields of a dataclass that differ from their defaults."""
    values = {field.name: (getattr(record, field.name), field.default) for field in dataclasses.fields(record)}
    return {name: value for name, (value, default) in values.items() if value != default}
