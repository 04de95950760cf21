"""warp-trunk triangulate"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from warp_trunk.io.file_access import check_place
from warp_trunk.preparation.reconstruction import read_film, triangulate, write_triangulation

from .exit_status import OK
from .spread import mean_and_largest


@dataclass(frozen=True, kw_only=True)
class Triangulate:
    """Find landmarks in space from their places on two calibrated radiographs."""

    pa: Path
    """Places on the postero-anterior film: CSV with the columns name, u, v [mm on the film, or pixels]."""
    pa_matrix: Path
    """Its projection: a text file with 3 lines of 4 numbers, for points in mm and LPS axes."""
    lateral: Path
    """Places of the same landmarks on the lateral film."""
    lateral_matrix: Path
    """Its projection."""
    out: Path
    """CSV of landmarks to write: name, x, y, z [mm], their reprojection error and their uncertainty."""
    limit: float = 5.0
    """Reprojection error above which landmarks are refused [units of the films]."""
    noise: float | None = None
    """Standard deviation of a coordinate on the films [their units]; estimated when left out."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the landmarks and says how well they are known."""
        check_place(self.out)
        first, second = read_film(self.pa, self.pa_matrix), read_film(self.lateral, self.lateral_matrix)
        found = triangulate(first, second, self.limit, self.noise)
        write_triangulation(self.out, found)
        names = found.landmarks.names
        print(f"{len(names)} landmarks written to {self.out}")
        print(f"Reprojection error: {mean_and_largest(found.miss.max(axis=1), names, 'in units of the films')}")
        print(
            f"Expected error in space, for {found.noise:.2f} in each coordinate on the films: "
            f"{mean_and_largest(found.error, names)}"
        )
        return OK
