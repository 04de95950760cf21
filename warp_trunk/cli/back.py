"""warp-trunk fit-back"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from tyro.conf import Positional

from warp_trunk.case import write_case
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.axes import MILLIMETRES
from warp_trunk.case.folders import refuse_case
from warp_trunk.case.landmarks import Landmarks, read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.back_points import NOISY
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_names import name_of
from warp_trunk.io.point_files import read_back
from warp_trunk.io.surface_files import read_surface
from warp_trunk.measures.back import TURN
from warp_trunk.preparation.back_scan.body import atlas_body, made_body
from warp_trunk.preparation.back_scan.fit import FittedBack, fit_back
from warp_trunk.preparation.back_scan.spine import TURN_SD
from warp_trunk.preparation.deformity.patient_spine import read_patient_spine
from warp_trunk.run.progress import Progress
from warp_trunk.spine import CobbAngle, cobb_angles

from .output import OK, next_command, read_bones

LEAST_COBB = 25.0
"""A smaller curve is not operated [degrees]."""


@dataclass(frozen=True, kw_only=True)
class FitBack:
    """Make a case from a scan of the back, the line of the spine and markers of the pelvis.

    What they do not show, above all front and ribs, is taken from a body that is fitted to them; the case says so.
    """

    back: Positional[Path]
    """Points or an open surface of the back (.ply, .obj, .stl, .xyz, .csv): +x left, +y back, +z up."""
    spine: Path
    """In the frame of the scan: a line x,y,z through the vertebral bodies from C7 down; or a table name,x,y,z of
    T4_body, T4_left_pedicle, T4_right_pedicle and so on down to L5; or landmarks as `triangulate` writes them."""
    markers: Path
    """Markers on the skin: name,x,y,z with C7, PSIS_left and PSIS_right (or ASIS_left and ASIS_right)."""
    out: Path
    """Case folder to write, with fit.png."""
    atlas: Path | None = None
    """Folder with skin.ply and bones/ of a straight body to fit; one that the program makes when left out."""
    units: Literal["mm", "cm", "m", "in"] = "mm"
    """Unit of the scan, the spine and the markers."""

    def run(self) -> int:
        """Writes the case and prints how well it fits, and what is invented."""
        refuse_case(self.out)
        if self.out.exists() and not self.out.is_dir():
            raise InputError(f"{self.out}: is a file; give the name of a folder")
        size = MILLIMETRES[self.units]
        with Progress() as progress:
            with progress.stage("load", f"reading {self.back}"):
                points, colours = read_back(self.back, size)
                spine = read_patient_spine(self.spine, size)
                table = read_landmarks(self.markers)
                markers = Landmarks(table.names, table.points * size)
                if self.atlas is None:
                    body = made_body()
                else:
                    bones = read_bones(self.atlas / "bones")
                    body = atlas_body(read_surface(self.atlas / "skin.ply"), bones, name_of(self.atlas.resolve()))
            with progress.stage("fit", "fitting a body to the scan"):
                files, name = (str(self.back), str(self.spine), str(self.markers)), name_of(self.out.resolve())
                fit = fit_back(points, spine, markers, body, name, colours=colours, files=files)
            with progress.stage("write", f"writing {self.out}"):
                from warp_trunk.report.scan_pictures import fit_picture  # brings matplotlib

                write_case(self.out, fit.case)
                write_whole(self.out / "fit.png", fit_picture(fit))
        print(fit_text(fit, spine.kind))
        print(f"Case written to {self.out}; look at {self.out / 'fit.png'}")
        curves = cobb_angles(fit.case.landmarks_before)
        largest = max(curves, key=lambda curve: curve.angle, default=None)
        if largest is None or largest.angle < LEAST_COBB:
            most = (
                "none" if largest is None else f"{largest.angle:.0f} degrees, {largest.upper} to {largest.lower}"
            )
            print(f"There is no curve of {LEAST_COBB:g} degrees to correct; the largest is {most}")
            return OK
        print(f"The largest curve is {largest.angle:.0f} degrees, {largest.upper} to {largest.lower}. Plan it:")
        uiv, liv = fused(largest)
        ends = ("--uiv", uiv, "--liv", liv, "--curve", f"{largest.apex},correction=0.65")
        print(next_command("plan", self.out, "--out", f"{self.out}_planned", *ends))
        return OK


def fused(curve: CobbAngle) -> tuple[str, str]:
    """The vertebrae that a first plan joins: T4 to L1, or the ends of a curve that has its apex elsewhere."""
    inside = VERTEBRAE[VERTEBRAE.index("T4") : VERTEBRAE.index("L1") + 1]
    return ("T4", "L1") if curve.apex in inside[1:-1] else (curve.upper, curve.lower)


def fit_text(fit: FittedBack, kind: str) -> str:
    """How well a body fits a scan, and what of it is invented, in lines."""
    d = fit.distance
    far = f"mean {d.mean():.2f} mm, 95 % nearer than {np.percentile(d, 95.0):.2f} mm, largest {d.max():.1f} mm"
    forward = int(fit.forward.argmax())
    turn = f"{TURN:g} degrees for each mm of sideways way" if kind == "line" else "as given"
    lines = [
        f"Fitted {fit.body}, scaled by {fit.scale:.2f}: {len(d)} points of the trunk, {far}",
        f"Left out {len(fit.left_out)} of {len(d) + len(fit.left_out)} points: surroundings, arms, hair, clothes, "
        "stray points",
        f"The points of the scan scatter by {fit.scan.noise:.2g} mm about the skin"
        + (", so they were smoothed" if fit.scan.noise > NOISY else ""),
        f"Invented: {100.0 * fit.invented:.0f} % of the skin, the ribs, the pelvis but for its turn",
        f"Turn of the vertebrae: {turn}, ±{TURN_SD[kind]:g} degrees",
    ]
    if fit.forward[forward] >= 1.0:
        level = VERTEBRAE[forward]
        lines.append(f"Vertebrae went forward to lie under the skin, {level} by {fit.forward[forward]:.0f} mm")
    if np.linalg.norm(fit.moved) >= 5.0:
        left, back, up = (f"{way:+z.0f}" for way in fit.moved)
        lines.append(f"The pelvis went {left} mm to the left, {back} back and {up} up, to lie under L5")
    return "\n".join(lines)
