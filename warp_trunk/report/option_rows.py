"""The options of a run as rows: words and units in place of Python's names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

UNITS = {
    "bone_margin": "mm",
    "bone_voxel": "mm",
    "bone_edge_length": "mm",
    "bone_tolerance": "mm",
    "smallest_dihedral": "degrees",
    "largest_dihedral": "degrees",
    "tolerance": "mm",
    "gravity": "m/s^2",
    "skin_rigidity": "N mm",
    "density": "kg/m^3",
    "youngs_modulus": "kPa",
}
"""Units of options by name, as their documentation has them; all others have none."""
_SHOWN = {"m/s^2": "m/s²", "kg/m^3": "kg/m³", "degrees": "°"}


def option_rows(parameters: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Each option in words, as on the command line but for its dashes, with its value and unit."""
    return [(name.replace("_", " "), value_text(value, UNITS.get(name, ""))) for name, value in parameters.items()]


def value_text(value: object, unit: str = "") -> str:
    """A value as text, with its unit; a dash for none."""
    if value is None or value == []:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {_SHOWN.get(unit, unit)}".rstrip()
