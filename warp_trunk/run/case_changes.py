"""The changes that a command makes in the cases that it simulates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from warp_trunk.case.tissue_file import with_constants

from .patient import layers_from
from .unread_options import refuse_unread

if TYPE_CHECKING:
    from warp_trunk.case import Case

    from .options import RunOptions


@dataclass(frozen=True)
class CaseChanges:
    """Values that are given for every case, which travel to the workers of a cohort."""

    constants: dict[str, float] = field(default_factory=dict)
    """Constants of tissue and ribs by their names in tissue.toml, in place of those of the case."""
    given: dict[str, str] = field(default_factory=dict)
    """Options that are given, by their names in Python, and as they were written."""

    def of(self, case: Case, options: RunOptions) -> Case:
        """A case with the constants.

        Raises:
            InputError: a constant that the case cannot have, or an option that its model does not read.
        """
        case = with_constants(case, self.constants)
        refuse_unread(self.given, options, layered=layers_from(case, options) != "none")
        return case
