"""The table [study] of case.toml: what a study of several cases needs to know of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from warp_trunk.errors import InputError

Pose = Literal["surgery", "bending"]
"""The change of the trunk from before to after."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """The patient of a case, and what is known about it besides the trunk."""

    patient: str = ""
    """Identifier of the patient: cases with the same one are of one person. The case itself if empty."""
    pose: Pose = "surgery"
    """The change from before to after: surgery, or sideways bending of the same patient, when the landmarks after
    and the actual skin are those of the bent trunk."""
    months_after: float | None = None
    """Months from surgery to the scan of the actual skin; None if unknown."""
    virtual: bool = False
    """Whether the case, including the actual skin, was made by a computer and is of no patient."""

    def __post_init__(self) -> None:
        """Raises InputError for an unknown pose, or a time out of range."""
        if self.pose not in get_args(Pose):
            raise InputError(
                f"study: 'pose' must be one of {', '.join(get_args(Pose))}, not '{self.pose}'; write what lies "
                "between before and after"
            )
        if self.months_after is not None and not 0.0 <= self.months_after <= 1200.0:  # nor is NaN
            raise InputError(
                f"study: 'months_after' must be from 0 to 1200 months, not {self.months_after:g}; correct it"
            )
