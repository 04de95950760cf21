"""warp-trunk close"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, UseAppendAction

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import check_written, read_surface, write_surface
from warp_trunk.io.transform_file import read_transform
from warp_trunk.preparation.scanning import (
    ClosedSkin,
    CloseOptions,
    align_parts,
    check_parts,
    close_skin,
    moved,
)
from warp_trunk.run.progress import Progress

from .inputs import cut_planes
from .output import OK


@dataclass(frozen=True, kw_only=True)
class Close:
    """Make one closed skin of a scan with holes, or of scans that overlap."""

    parts: Positional[tuple[Path, ...]]
    """Surfaces of the skin, oriented outward, in mm and LPS axes."""
    out: Path
    """File for the closed skin: .ply, .stl, .obj, .off or .glb."""
    transforms: tuple[Path, ...] = ()
    """A text file for each part, in order, with the 16 numbers of the rigid 4x4 matrix into the common frame."""
    refine: bool = False
    """Align the parts to the first one where they overlap, by some millimetres."""
    cut_above: float | None = None
    """Cut the neck flat at this height z [mm]."""
    cut_below: float | None = None
    """Cut the thighs flat at this height z [mm]."""
    cut: UseAppendAction[tuple[str, ...]] = ()
    """Cut flat at planes, for example at the arms. x,y,z,nx,ny,nz,radius: a point, the normal towards the removed
    side, and the distance from the point to which the cut reaches [mm]."""
    options: Annotated[CloseOptions, tyro.conf.arg(name="")] = field(default_factory=CloseOptions)
    """How the surface is made."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the closed skin."""
        cuts = cut_planes(self.cut, self.cut_above, self.cut_below)
        check_written(self.out)
        if self.transforms and len(self.transforms) != len(self.parts):
            raise InputError(
                f"--transforms: {len(self.transforms)} files for {len(self.parts)} parts; give one for each"
            )
        with Progress() as progress:
            with progress.stage("load", "reading the scans"):
                parts = self._read()
                check_parts(parts)
            if self.refine:
                with progress.stage("align", "moving the parts onto each other"):
                    parts, alignments = align_parts(parts)
                for name, by in alignments.items():
                    print(
                        f"{name}: moved by {by.shift:.2f} mm and {by.turn:.2f} degrees, "
                        f"now {by.distance:.2f} mm from the others"
                    )
            with progress.stage("close", "closing the skin"):
                closed = close_skin(parts, cuts, self.options)
            write_surface(self.out, closed.surface)
        _tell(closed)
        print(f"Closed skin of {len(closed.surface.faces)} triangles written to {self.out}")
        return OK

    def _read(self) -> dict[str, Surface]:
        parts = {str(path): read_surface(path) for path in self.parts}
        if len(parts) < len(self.parts):
            raise InputError("parts: a file is given twice; give each once")
        matrices = [read_transform(path) for path in self.transforms]
        for name, matrix in zip(parts, matrices, strict=False):
            parts[name] = moved(parts[name], matrix)
        return parts


def _tell(closed: ClosedSkin) -> None:
    for opening in closed.openings:
        what = "end, flat" if opening.is_end else "hole"
        place = "({:.0f}, {:.0f}, {:.0f}) mm".format(*opening.centre)
        print(f"Closed: {what}, {opening.area / 100.0:.1f} cm2 at {place}")
