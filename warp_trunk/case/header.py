"""case.toml: the name of a case, the units and axes of its files, and its tissues."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text

from .axes import MILLIMETRES, Axes
from .keys import numbers, quoted, refuse_unknown, shown
from .landmarks import COLUMNS
from .layers import LayerTable, layer_table, layer_text
from .rib_shares import RibShares
from .study import Study, study_lines, study_table
from .uncertainty import Uncertainty

POSTURES = ("standing", "supine", "prone")
"""How a patient may have been scanned."""
_MOST = 1_000_000
"""No case.toml is longer than this [bytes]."""


@dataclass(frozen=True)
class CaseHeader:
    """What case.toml says; every key may be left out."""

    name: str
    """What to call the case; the name of its folder when left out."""
    units: str = "mm"
    """Unit of every length in the folder: mm, cm or m."""
    axes: Axes = dataclasses.field(default_factory=lambda: Axes("LPS"))
    """Patient axes of every position in the folder."""
    landmark_columns: tuple[str, ...] = COLUMNS
    """Columns of the CSV files of landmarks that hold name, x, y and z."""
    posture: str = "standing"
    """How the patient was scanned, one of `POSTURES`."""
    tissue: Tissue = dataclasses.field(default_factory=Tissue)
    """Constants of the soft tissue, from the table [tissue]."""
    layers: LayerTable | None = None
    """Skin, fat and muscle, from the table [layers]."""
    ribs: RibShares = dataclasses.field(default_factory=RibShares)
    """How ribs follow the spine, from the table [ribs]."""
    uncertainty: Uncertainty = dataclasses.field(default_factory=Uncertainty)
    """How uncertain the case is, from the table [uncertainty]."""
    study: Study = dataclasses.field(default_factory=Study)
    """What a study of several cases needs to know of it, from the table [study]."""


_KINDS: dict[str, tuple[type, str]] = {
    **dict.fromkeys(("name", "units", "axes", "posture"), (str, "text")),
    "landmark_columns": (list, "a list of four column names"),
}
"""What each key of case.toml is, in Python and in words; all others are tables."""


def read_header(path: Path) -> CaseHeader:
    """Read case.toml.

    Raises:
        InputError: a missing or unreadable file, an unknown key (the nearest known one is named), a value of
            the wrong type or one that is not allowed.
    """
    text = read_text(path, "a case needs this file, which may be empty", _MOST)
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({error}); correct it there") from error
    table.pop("skin_after_is_placeholder", None)  # version 0.1 wrote it
    refuse_unknown(path, table, [field.name for field in dataclasses.fields(CaseHeader)], "")
    for key, value in table.items():
        kind, expected = _KINDS.get(key, (dict, f"a table, [{key}]"))
        if not isinstance(value, kind):
            raise InputError(f"{path}: '{key}' must be {expected}, not {shown(value)}; correct it")
    values: dict[str, Any] = {"name": path.resolve().parent.name, **table}
    if values.get("units", "mm") not in MILLIMETRES:
        raise InputError(
            f"{path}: 'units' must be one of {', '.join(MILLIMETRES)}, not '{values['units']}'; "
            "write the unit of the surfaces and landmarks"
        )
    if values.get("posture", "standing") not in POSTURES:
        raise InputError(
            f"{path}: 'posture' must be one of {', '.join(POSTURES)}, not '{values['posture']}'; "
            "write how the patient was scanned"
        )
    if "landmark_columns" in values:
        values["landmark_columns"] = _columns(path, values["landmark_columns"])
    try:
        if "axes" in values:
            values["axes"] = Axes(values["axes"])
        if "tissue" in values:
            values["tissue"] = _tissue(path, values["tissue"])
        if "layers" in values:
            values["layers"] = layer_table(path, values["layers"])
        if "ribs" in values:
            known = [field.name for field in dataclasses.fields(RibShares)]
            values["ribs"] = RibShares(**numbers(path, values["ribs"], known, "ribs."))
        if "uncertainty" in values:
            known = [field.name for field in dataclasses.fields(Uncertainty)]
            values["uncertainty"] = Uncertainty(**numbers(path, values["uncertainty"], known, "uncertainty."))
        if "study" in values:
            values["study"] = study_table(path, values["study"])
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    return CaseHeader(**values)


def _columns(path: Path, names: list[Any]) -> tuple[str, ...]:
    if (
        len(names) != 4
        or len(set(map(str, names))) != 4
        or not all(isinstance(name, str) and name for name in names)
    ):
        raise InputError(
            f"{path}: 'landmark_columns' must be four different names of columns, those of name, x, y and z, "
            f"not {str(names)[:60]}; correct it"
        )
    return tuple(names)


def _tissue(path: Path, table: dict[str, Any]) -> Tissue:
    return Tissue(**numbers(path, table, [field.name for field in dataclasses.fields(Tissue)], "tissue."))


def header_text(header: CaseHeader) -> str:
    """The text of case.toml, which `read_header` reads back to the last bit."""
    lines = [
        f"name = {quoted(header.name)}",
        f'units = "{header.units}"',
        f'axes = "{header.axes.code}"  # the patient\'s left, back and up are L, P and S',
        f'posture = "{header.posture}"',
        "",
        "[tissue]",
    ]
    lines += [f"{key} = {float(value)!r}" for key, value in dataclasses.asdict(header.tissue).items()]
    if header.ribs != RibShares():
        lines += ["", "[ribs]"]
        lines += [f"{key} = {float(value)!r}" for key, value in dataclasses.asdict(header.ribs).items()]
    changed = [
        f"{field.name} = {value!r}"
        for field in dataclasses.fields(Uncertainty)
        if (value := float(getattr(header.uncertainty, field.name))) != field.default
    ]
    if changed:
        lines += ["", "[uncertainty]", *changed]
    lines += study_lines(header.study)
    return "\n".join(lines) + "\n" + ("" if header.layers is None else layer_text(header.layers))
