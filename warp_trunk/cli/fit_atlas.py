"""warp-trunk fit-atlas"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.surface_files import write_surface
from warp_trunk.preparation.reconstruction import fit_atlas

from .bone_folder import read_bones
from .exit_status import OK
from .spread import mean_and_largest


@dataclass(frozen=True, kw_only=True)
class FitAtlas:
    """Carry the generic bones of an atlas onto the landmarks of a patient, by dual kriging."""

    bones: Path
    """Folder with one surface for each bone of the atlas, named after it, in mm and LPS axes."""
    atlas: Path
    """Landmarks on these bones: CSV (name,x,y,z), .mrk.json or .fcsv."""
    patient: Path
    """Landmarks of the patient, under the same names."""
    out: Path
    """Folder to write the patient's bones to, and atlas_fit.csv with the error at each landmark."""
    drift: Literal["linear", "constant"] = "linear"
    """What a bone may do as a whole beside moving rigidly: grow and shear, or nothing."""
    nugget: float = 0.0
    """How much to smooth: variance of the landmarks over the slope of the variogram [mm]; 0 meets them all."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the bones and prints the cross-validation error of the landmarks."""
        if self.out.exists() and not self.out.is_dir():
            raise InputError(f"{self.out}: is a file; give the name of a folder")
        atlas, patient = read_landmarks(self.atlas), read_landmarks(self.patient)
        fit = fit_atlas(read_bones(self.bones), atlas, patient, self.drift, self.nugget)
        self.out.mkdir(parents=True, exist_ok=True)
        for name, bone in fit.bones.items():
            write_surface(self.out / f"{name}.ply", bone)
        with (
            atomic_write(self.out / "atlas_fit.csv") as unfinished,
            unfinished.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["name", "error", "error_left_out"])
            writer.writerows(zip(fit.names, fit.miss.tolist(), fit.left_out.tolist(), strict=True))
        print(
            f"{len(fit.bones)} bones written to {self.out}: {len(fit.own)} by their own landmarks, "
            f"{len(fit.bones) - len(fit.own)} by those of all bones"
        )
        print(f"Landmarks are missed by {mean_and_largest(fit.miss, fit.names)}")
        if np.isfinite(fit.left_out).any():
            print(f"Left out one at a time: {mean_and_largest(fit.left_out, fit.names)}")
        return OK
