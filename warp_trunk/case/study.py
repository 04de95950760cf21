"""What a study of several cases needs to know of each, from the table [study] of case.toml."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from warp_trunk.errors import InputError

from .keys import is_number, quoted, refuse_unknown, shown

Pose = Literal["surgery", "bending"]
"""What changed the trunk from before to after."""
_KINDS = {"patient": str, "pose": str, "months_after": float, "virtual": bool}


@dataclass(frozen=True, kw_only=True)
class Study:
    """Whose trunk a case is, and what is known of it beside the trunk itself."""

    patient: str = ""
    """Whose it is; cases with the same word are of one person. The case itself where it is empty."""
    pose: Pose = "surgery"
    """What lies between before and after: surgery, or the same patient bending sideways, when the landmarks after
    and the actual skin are those of the bent trunk."""
    months_after: float | None = None
    """Months from surgery to the actual skin; None where that is not known."""
    virtual: bool = False
    """Whether the case, the actual skin with it, was made by a computer: nobody's trunk."""

    def __post_init__(self) -> None:
        """Raises InputError for a pose that is not known, or a time that cannot be."""
        if self.pose not in get_args(Pose):
            raise InputError(
                f"study: 'pose' must be one of {', '.join(get_args(Pose))}, not '{self.pose}'; write what lies "
                "between before and after"
            )
        if self.months_after is not None and not 0.0 <= self.months_after <= 1200.0:  # nor is NaN
            raise InputError(
                f"study: 'months_after' must be from 0 to 1200 months, not {self.months_after:g}; correct it"
            )


def study_table(path: Path, table: dict[str, Any]) -> Study:
    """The table [study] of a case.toml.

    Raises:
        InputError: an unknown key, or a value of another type or that cannot be.
    """
    refuse_unknown(path, table, [field.name for field in dataclasses.fields(Study)], "study.")
    for key, value in table.items():
        kind = _KINDS[key]
        if not (is_number(value) and math.isfinite(value) if kind is float else isinstance(value, kind)):
            said = {str: "text", float: "a number", bool: "true or false"}[kind]
            raise InputError(f"{path}: 'study.{key}' must be {said}, not {shown(value)}; correct it")
    return Study(**table)


def study_lines(study: Study) -> list[str]:
    """The lines of a case.toml that say it, none where it is the default."""
    said = []
    for field in dataclasses.fields(Study):
        value = getattr(study, field.name)
        if value != field.default:
            text = quoted(value) if isinstance(value, str) else str(value).lower()
            said.append(f"{field.name} = {text}")
    return ["", "[study]", *said] if said else []
