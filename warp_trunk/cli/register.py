"""warp-trunk register"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.io.surface_files import check_written, read_surface, write_surface
from warp_trunk.preparation.reconstruction import register_skin

from .exit_status import OK
from .spread import mean_and_largest


@dataclass(frozen=True, kw_only=True)
class Register:
    """Bring the scanned skin into the frame of the bones, by markers seen on the skin and on the films."""

    skin: Path
    """The scanned skin, in mm and LPS axes."""
    on_skin: Path
    """Markers on it, in the frame of the scan: CSV (name,x,y,z), .mrk.json or .fcsv."""
    on_films: Path
    """The same markers in the frame of the bones, such as `warp-trunk triangulate` writes."""
    out: Path
    """Surface file to write."""
    nugget: float = 0.0
    """How much to smooth: variance of the markers over the slope of the variogram [mm]; 0 meets them all."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the skin and prints the rigid and the elastic part of its motion."""
        check_written(self.out)
        skin, on_skin, on_films = (
            read_surface(self.skin),
            read_landmarks(self.on_skin),
            read_landmarks(self.on_films),
        )
        found = register_skin(skin, on_skin, on_films, self.nugget)
        write_surface(self.out, found.skin)
        turned = np.degrees(found.rigid.rotation.magnitude())
        centre = on_skin.points.mean(axis=0)
        shift = np.linalg.norm(found.rigid.apply(centre) - centre)
        print(f"Skin written to {self.out}")
        print(
            f"Rigid part: turns by {turned:.2f} degrees, shifts by {shift:.1f} mm; markers are off by "
            f"{mean_and_largest(found.rigid_miss, found.names)}"
        )
        print(
            f"Spline part: stretches by {100.0 * found.strain.min():+z.2f} to {100.0 * found.strain.max():+z.2f} "
            f"%, bends the skin by {mean_and_largest(found.bending)}; markers are off by "
            f"{mean_and_largest(found.miss, found.names)}; least volume {found.least_volume:.2f}, no fold"
        )
        return OK
