"""How well landmarks are found on the bones of a curved spine, on anatomy where the truth is known.

Usage: python scripts/check_landmarks.py ANATOMY

ANATOMY holds bones/ of a straight trunk, as for make-case. Landmarks are found on the straight bones, curves are
imposed, and what is found on the curved bones is compared with the landmarks that were carried along. Then the
same for a spine whose bones are harder: bent by the spline, meshed anew from voxels, coarse, noisy; and for a
patient who leans or is turned.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from warp_trunk import Landmarks, SpineCurve, Surface, find_landmarks, read_surface
from warp_trunk.case.landmarks import ASIS, VERTEBRAE
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.distance_field import Grid, SurfaceDistance
from warp_trunk.geometry.isosurface import one_solid, zero_surface
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.measures.axial_rotation import axial_rotation
from warp_trunk.measures.spine import asis_axis, spine_of
from warp_trunk.preparation.deformity import correct
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses

Bones = dict[str, Surface]
CURVES = (
    SpineCurve(kind="thoracic", cobb=40.0),
    SpineCurve(kind="thoracic", cobb=60.0),
    SpineCurve(kind="thoracic", cobb=90.0),
    SpineCurve(kind="thoracolumbar", cobb=45.0, direction="left"),
    SpineCurve(kind="double_major", cobb=75.0),
)


@dataclass(frozen=True)
class Errors:
    """Distances of landmarks found from landmarks known."""

    mean: float
    """[mm]"""
    most: float
    """95 % are nearer [mm]."""
    largest: float
    """[mm]"""
    rotation: float
    """Largest error of a vertebra's axial rotation [deg]."""
    unsure: tuple[str, ...]
    """Vertebrae without landmarks."""

    def row(self) -> str:
        """Cells of a table."""
        cells = [f"{self.mean:.2f}", f"{self.most:.2f}", f"{self.largest:.2f}", f"{self.rotation:.2f}"]
        return " | ".join([*cells, ", ".join(self.unsure) or "none"])


def main(folder: str) -> None:
    """Prints both tables for the anatomy in a folder."""
    bones = spine_and_hips(Path(folder))
    straight = find_landmarks(bones).complete()
    print("| curve | mean | 95 % | largest | rotation | unsure |\n|---|---|---|---|---|---|")
    for curve in CURVES:
        curved, truth = imposed(bones, straight, curve)
        name = f"{curve.kind.replace('_', ' ')} {curve.cobb:g} {curve.direction}"
        print(f"| {name} | {compare(curved, truth).row()} |", flush=True)
    print("\n| thoracic 60 right | mean | 95 % | largest | rotation | unsure |\n|---|---|---|---|---|---|")
    for name, harder in HARDER.items():
        curved, truth = harder(bones, straight)
        print(f"| {name} | {compare(curved, truth).row()} |", flush=True)


def spine_and_hips(folder: Path) -> Bones:
    """The bones that have landmarks."""
    return {name: read_surface(folder / "bones" / f"{name}.ply") for name in (*VERTEBRAE, *ASIS.values())}


def imposed(bones: Bones, straight: Landmarks, curve: SpineCurve) -> tuple[Bones, Landmarks]:
    """Bones and landmarks of the curved spine; vertebrae move rigidly and the pelvis stays, as in make-case."""
    poses = vertebra_poses(straight, curve)
    curved = {
        name: Surface(poses[name](bone.vertices), bone.faces) if name in poses else bone
        for name, bone in bones.items()
    }
    return curved, correct(straight, curve, 0.0)


def compare(bones: Bones, truth: Landmarks) -> Errors:
    """What is found on bones against what is known."""
    found = find_landmarks(bones)
    names = found.landmarks.names
    known = Landmarks(names, np.array([truth.point(name) for name in names]))
    off = np.linalg.norm(found.landmarks.points - known.points, axis=1)
    turned, right = (axial_rotation(spine_of(marks), asis_axis(marks)) for marks in (found.landmarks, known))
    return Errors(
        mean=float(off.mean()),
        most=float(np.percentile(off, 95.0)),
        largest=float(off.max()),
        rotation=max(abs((turned[name] or 0.0) - (right[name] or 0.0)) for name in turned),
        unsure=tuple(found.unsure),
    )


Harder = Callable[[Bones, Landmarks], tuple[Bones, Landmarks]]


def each(change: Callable[[Surface], Surface]) -> Harder:
    """Every bone of the curved spine changed; its landmarks stay where they were."""

    def harder(bones: Bones, straight: Landmarks) -> tuple[Bones, Landmarks]:
        curved, truth = imposed(bones, straight, CURVES[1])
        return {name: change(bone) for name, bone in curved.items()}, truth

    return harder


def patient(matrix: np.ndarray) -> Harder:
    """The whole patient turned or mirrored."""

    def harder(bones: Bones, straight: Landmarks) -> tuple[Bones, Landmarks]:
        curved, truth = imposed(bones, straight, CURVES[1])
        flip = np.linalg.det(matrix) < 0.0
        moved = {
            other_side(name) if flip else name: Surface(
                bone.vertices @ matrix.T, bone.faces[:, ::-1].copy() if flip else bone.faces
            )
            for name, bone in curved.items()
        }
        names = tuple(other_side(name) if flip else name for name in truth.names)
        return moved, Landmarks(names, truth.points @ matrix.T)

    return harder


def other_side(name: str) -> str:
    """The name of a mirrored bone or landmark."""
    swapped = {"left": "right", "right": "left"}
    return "_".join(swapped.get(word, word) for word in name.split("_"))


def bent(bones: Bones, straight: Landmarks) -> tuple[Bones, Landmarks]:
    """Bones carried by the spline through the landmarks, which wedges and twists them."""
    truth = correct(straight, CURVES[1], 0.0)
    spline = fit_spline(straight.points, truth.points)
    return {name: Surface(spline(bone.vertices), bone.faces) for name, bone in bones.items()}, truth


def noisy(surface: Surface) -> Surface:
    """Vertices off by 0.4 mm in each direction (standard deviation)."""
    rng = np.random.default_rng(len(surface.vertices))
    return Surface(surface.vertices + rng.normal(0.0, 0.4, surface.vertices.shape), surface.faces)


def voxels(surface: Surface) -> Surface:
    """As from a label map of 1.25 x 1.25 x 2.5 mm."""
    flat = np.array([1.0, 1.0, 0.5])
    squeezed = Surface(surface.vertices * flat, surface.faces)
    spacing = 1.25
    lower = squeezed.vertices.min(axis=0) - 2.5
    x, y, z = (int(n) for n in np.ceil((squeezed.vertices.max(axis=0) + 2.5 - lower) / spacing) + 1)
    shape = (x, y, z)
    grid = Grid(lower, spacing, shape)
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    field = SurfaceDistance(squeezed).at(grid.positions(nodes)).reshape(shape)
    labels = np.where(field < 0.0, -0.5 * spacing, 0.5 * spacing)  # a label map knows inside and outside only
    meshed = zero_surface(one_solid(labels, spacing), grid)
    return Surface(meshed.vertices / flat, meshed.faces)


def turned(axis: str, degrees: float) -> np.ndarray:
    """Rotation matrix."""
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


HARDER: Mapping[str, Harder] = {
    "bones bent by the spline": bent,
    "edges of 4 mm": each(lambda bone: coarsen(bone, 4.0, 0.5)),
    "noise of 0.4 mm": each(noisy),
    "label map of 1.25 x 1.25 x 2.5 mm": each(voxels),
    "mirrored": patient(np.diag([-1.0, 1.0, 1.0])),
    "turned by 30 degrees": patient(turned("z", 30.0)),
    "leaning aside by 20 degrees": patient(turned("y", 20.0)),
    "leaning forward by 20 degrees": patient(turned("x", -20.0)),
}
"""What is done to the spine with the second curve."""

if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    main(sys.argv[1])
