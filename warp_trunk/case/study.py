"""The table [study] of case.toml: what a study of several cases needs to know of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from warp_trunk.errors import check_ranges

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
    synthetic: bool = False
    """Whether the case, including the actual skin, was made by a computer and is of no patient."""

    def __post_init__(self) -> None:
        """Raises InputError for a time out of range."""
        check_ranges(self, "study", " months", months_after=(0.0, 1200.0))
