"""From films, markers and an atlas to bones and skin: warp-trunk triangulate, register and fit-atlas."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import csv_text, write_whole
from warp_trunk.io.file_access import check_place
from warp_trunk.io.surface_files import check_written, read_surface, write_surface
from warp_trunk.preparation.reconstruction.atlas import fit_atlas
from warp_trunk.preparation.reconstruction.registration import register_skin
from warp_trunk.preparation.reconstruction.triangulation import read_film, triangulate, write_triangulation

from .output import OK, mean_and_largest, read_bones


@dataclass(frozen=True, kw_only=True)
class Triangulate:
    """Compute landmarks in space from two calibrated radiographs."""

    pa: Path
    """Landmarks on the postero-anterior film: CSV with the columns name, u, v [mm on the film, or pixels]."""
    pa_matrix: Path
    """Projection matrix of this film: a text file with 3 lines of 4 numbers, for points in mm and LPS axes."""
    lateral: Path
    """The same landmarks on the lateral film."""
    lateral_matrix: Path
    """Projection matrix of this film."""
    out: Path
    """CSV of landmarks to write: name, x, y, z [mm], their reprojection error and their uncertainty."""
    limit: float = 5.0
    """Reprojection error above which landmarks are refused [units of the films]."""
    noise: float | None = None
    """Standard deviation of a coordinate on the films [their units]; estimated by default."""

    def run(self) -> int:
        """Writes the landmarks and says how well they are known."""
        check_place(self.out)
        first, second = read_film(self.pa, self.pa_matrix), read_film(self.lateral, self.lateral_matrix)
        made = triangulate(first, second, self.limit, self.noise)
        write_triangulation(self.out, made)
        names = made.landmarks.names
        print(f"{len(names)} landmarks written to {self.out}")
        print(f"Reprojection error: {mean_and_largest(made.miss.max(axis=1), names, 'in units of the films')}")
        print(
            f"Expected error in space, for {made.noise:.2f} in each coordinate on the films: "
            f"{mean_and_largest(made.error, names)}"
        )
        return OK


@dataclass(frozen=True, kw_only=True)
class Register:
    """Move the scanned skin into the frame of the bones, by markers visible on the skin and on the films."""

    skin: Path
    """The scanned skin, in mm and LPS axes."""
    on_skin: Path
    """Markers on it, in the frame of the scan: CSV (name,x,y,z), .mrk.json or .fcsv."""
    on_films: Path
    """The same markers in the frame of the bones, as `warp-trunk triangulate` writes them."""
    out: Path
    """Surface file to write."""
    nugget: float = 0.0
    """Smoothing: variance of the markers over the slope of the variogram [mm]; 0 interpolates."""

    def run(self) -> int:
        """Writes the skin and prints the rigid and the elastic part of its motion."""
        check_written(self.out)
        on_skin, on_films = read_landmarks(self.on_skin), read_landmarks(self.on_films)
        fit = register_skin(read_surface(self.skin), on_skin, on_films, self.nugget)
        write_surface(self.out, fit.skin)
        turned = np.degrees(fit.rigid.angle)
        centre = on_skin.points.mean(axis=0)
        shift = np.linalg.norm(fit.rigid.apply(centre) - centre)
        print(f"Skin written to {self.out}")
        print(
            f"Rigid part: turns by {turned:.2f} degrees, shifts by {shift:.1f} mm; markers are off by "
            f"{mean_and_largest(fit.rigid_miss, fit.names)}"
        )
        print(
            f"Spline part: stretches by {100.0 * fit.strain.min():+z.2f} to {100.0 * fit.strain.max():+z.2f} "
            f"%, bends the skin by {mean_and_largest(fit.bending)}; markers are off by "
            f"{mean_and_largest(fit.miss, fit.names)}; least volume {fit.least_volume:.2f}, no fold"
        )
        return OK


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
    skin: Path | None = None
    """The patient's closed skin, in the frame of her landmarks: ribs and sternum are then fitted under it. Give
    --atlas-skin, too."""
    atlas_skin: Path | None = None
    """The skin around the bones of the atlas."""
    drift: Literal["linear", "constant"] = "linear"
    """Drift of the kriging: linear, by which a bone may grow and shear, or constant."""
    nugget: float = 0.0
    """Smoothing: variance of the landmarks over the slope of the variogram [mm]; 0 interpolates."""

    def run(self) -> int:
        """Writes the bones and prints the cross-validation error of the landmarks."""
        if self.out.exists() and not self.out.is_dir():
            raise InputError(f"{self.out}: is a file; give the name of a folder")
        atlas, patient = read_landmarks(self.atlas), read_landmarks(self.patient)
        files = [file for file in (self.atlas_skin, self.skin) if file is not None]
        if len(files) == 1:
            raise InputError("--skin and --atlas-skin: one is of no use without the other; give both or neither")
        skins = (read_surface(files[0]), read_surface(files[1])) if files else None
        fit = fit_atlas(read_bones(self.bones), atlas, patient, self.drift, self.nugget, skins=skins)
        self.out.mkdir(parents=True, exist_ok=True)
        for name, bone in fit.bones.items():
            write_surface(self.out / f"{name}.ply", bone)
        rows = zip(fit.names, fit.miss.tolist(), fit.left_out.tolist(), strict=True)
        write_whole(self.out / "atlas_fit.csv", csv_text([("name", "error", "error_left_out"), *rows]))
        own, by_all = len(fit.own), len(fit.bones) - len(fit.own)
        print(f"{len(fit.bones)} bones written to {self.out}: {own} by their own landmarks, {by_all} by all")
        print(f"Landmarks are missed by {mean_and_largest(fit.miss, fit.names)}")
        if np.isfinite(fit.left_out).any():
            print(f"Left out one at a time: {mean_and_largest(fit.left_out, fit.names)}")
        if fit.depth:
            least = min(fit.depth, key=fit.depth.__getitem__)
            side = "under" if fit.depth[least] >= 0.0 else "outside"
            print(f"Nearest to the skin comes {least}, {abs(fit.depth[least]):.1f} mm {side} it")
        else:
            print("Ribs and sternum are not fitted under a skin: give --skin and --atlas-skin for that")
        return OK
