"""warp-trunk cut"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from warp_trunk.case.axes import MILLIMETRES
from warp_trunk.case.header import read_header
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.io.surface_files import read_surface, surface_files, write_surface
from warp_trunk.preparation.osteotomy import cut_bone
from warp_trunk.preparation.scanning import CutPlane

from .output import OK


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Cut a bone of a case at a plane into closed parts, which can then move separately."""

    case: Positional[Path]
    """Case folder. The whole bone is kept in its folder bones_uncut, which no command reads."""
    bone: str
    """Name of the bone."""
    plane: tuple[float, float, float, float, float, float]
    """A point of the plane and its normal, x y z nx ny nz, in mm and in the axes of the case."""
    names: tuple[str, ...]
    """Names of the parts: the one that the normal points away from, then those beyond the plane, from larger
    to smaller x."""
    radius: float = math.inf
    """Cut only parts beyond the plane that come nearer to its point than this [mm]; by default all. A bone that is
    cut again stays whole in bones_uncut."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the parts in place of the bone."""
        header = read_header(self.case / "case.toml")
        files = surface_files(self.case / "bones")
        if self.bone not in files:
            raise InputError(f"--bone: there is no '{self.bone}' in {self.case / 'bones'}; give one that is there")
        for name in self.names:
            if Path(name).name != name or name.startswith(".") or (name in files and name != self.bone):
                raise InputError(f"--names: '{name}' is another bone, or cannot name a file; give another name")
        size, file = MILLIMETRES[header.units], files[self.bone]
        x, y, z, a, b, c = self.plane
        plane = CutPlane((x / size, y / size, z / size), (a, b, c), self.radius / size)
        parts = cut_bone(read_surface(file), plane, str(file))
        if len(parts) != len(self.names) or len(set(self.names)) < len(self.names):
            raise InputError(f"--names: {len(parts)} parts need as many different names, not {len(self.names)}")
        whole = self.case / "bones_uncut" / file.name
        whole.parent.mkdir(exist_ok=True)
        file.unlink() if whole.exists() else file.rename(
            whole
        )  # the whole bone stays, not what an earlier cut left
        for name, part in zip(self.names, parts, strict=True):
            write_surface(file.with_name(f"{name}.ply"), part)
            print(f"{name}: {enclosed_volume(part) * size**3 / 1000.0:.2f} cm3")
        print(f"Written to {file.parent}; the whole bone is {whole}")
        return OK
