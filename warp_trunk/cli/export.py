"""warp-trunk export"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from warp_trunk.case.case_writer import refuse_case
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.exchange import ENDINGS, write_volume
from warp_trunk.io.file_access import check_place
from warp_trunk.io.result_files import TRUNK
from warp_trunk.io.trunk_file import read_trunk
from warp_trunk.results import read_summary

from .output import OK


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the mesh of a result, with the motion of its bones, for another solver or viewer."""

    result: Positional[Path]
    """Result folder."""
    out: Path
    """File to write; its ending chooses the format: .vtu .vtk .xdmf .msh, .inp (Abaqus, CalculiX), .feb
    (FEBio)."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the file."""
        if self.out.suffix.lower() not in ENDINGS:
            known = ", ".join(ENDINGS)
            raise InputError(
                f"--out: a mesh cannot be written as '{self.out.suffix}'; end the name in one of {known}"
            )
        refuse_case(self.out)
        check_place(self.out)
        tissues = read_summary(self.result).tissues
        trunk, displacement = read_trunk(self.result / TRUNK)
        with atomic_write(self.out) as unfinished:
            write_volume(unfinished, trunk, displacement, tissues[0] if len(tissues) == 1 else Tissue())
        print(f"{len(trunk.tets)} tetrahedra, {int(trunk.prescribed.sum())} nodes on bone: {self.out}")
        return OK
