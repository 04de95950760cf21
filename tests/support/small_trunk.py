"""A box of tissue around a column of bone, small enough to see through: for tests that need a whole case.

The bone is called T10 and has no landmarks of its own, so that it goes where the spline of all landmarks does.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import rerun as rr

from support.known_spine import before_and_after
from warp_trunk.bone_motion.prescribed_motion import rigid_path, spline_path
from warp_trunk.case import Case
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.engine.relaxation import Energy, Relaxation, RelaxStatus
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.meshing import predicted_skin
from warp_trunk.recording import Recording
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import PreparedPatient, motions_of, patient_of

from .meshes import grid, trunk, turned_about_z, with_skin

CELLS = (4, 4, 6)
SIZE = np.array([300.0, 200.0, 420.0])
LEVELS = ("T4", "T8", "T12", "L3")


def small_trunk():
    """The mesh, and its skin with vertices in an order of their own."""
    nodes, tets, _ = grid(CELLS, 1.0)
    nodes = (nodes / CELLS - [0.5, 0.5, 0.0]) * SIZE
    inside = (np.abs(nodes[:, 0]) < 1.0) & (np.abs(nodes[:, 1]) < 60.0)
    mesh = with_skin(trunk(nodes, tets, inside & (nodes[:, 2] > 1.0) & (nodes[:, 2] < 419.0)))
    order = np.random.default_rng(3).permutation(len(mesh.skin_nodes))
    faces = np.argsort(order)[mesh.skin_faces].astype(np.int32)
    triangles = np.concatenate([mesh.tets[:, k] for k in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    on_bone = triangles[mesh.prescribed[triangles].all(axis=1)]
    skin_nodes = mesh.skin_nodes[order]
    mesh = replace(mesh, skin_nodes=skin_nodes, skin_faces=faces, bone_names=("T10",), bone_faces=on_bone)
    return mesh, Surface(nodes[skin_nodes], faces)


def box_mesh():
    """Its nodes, tetrahedra and boundary triangles, as plain arrays."""
    mesh, _ = small_trunk()
    return mesh.nodes, mesh.tets, mesh.skin_nodes[mesh.skin_faces]


def small_landmarks():
    """Six landmarks on each of four vertebrae, and the iliac spines."""
    offsets = [(0, -10, 11), (0, -10, -11), (13, 9, 5), (13, 9, -5), (-13, 9, 5), (-13, 9, -5)]
    names, points = ["asis_left", "asis_right"], [(120.0, -60.0, 40.0), (-120.0, -60.0, 40.0)]
    for level, height in zip(LEVELS, (360.0, 280.0, 200.0, 120.0), strict=True):
        for name, (x, y, z) in zip(VERTEBRA_POINTS, offsets, strict=True):
            names.append(f"{level}_{name}")
            points.append((float(x), 20.0 + y, height + z))
    return Landmarks(tuple(names), np.array(points))


def small_case():
    """A case and its mesh; surgery moves T8 by 12 mm to the left."""
    trunk, skin = small_trunk()
    before = small_landmarks()
    moved = before.points.copy()
    moved[[name.startswith("T8") for name in before.names], 0] += 12.0
    bones = {"T10": Surface(skin.vertices * [0.05, 0.05, 0.8] + [0.0, 20.0, 40.0], skin.faces)}
    return Case("small", skin, bones, before, Landmarks(before.names, moved)), trunk


def boned_case():
    """The same with a bone around all nodes of the mesh on bone, as a mesh made elsewhere is held to have."""
    case, trunk = small_case()
    at = trunk.nodes[trunk.prescribed]
    low, high = at.min(axis=0) - 4.0, at.max(axis=0) + 4.0
    box = low + (case.skin.vertices / SIZE + [0.5, 0.5, 0.0]) * (high - low)
    return replace(case, bones={"T10": Surface(box, case.skin.faces)}), trunk


def turned(trunk, degrees_at_top):
    """Displacement that turns each height about z, more towards the top: angles known at every level."""
    return turned_about_z(trunk.nodes, degrees_at_top * trunk.nodes[:, 2] / SIZE[2]) - trunk.nodes


@dataclass(frozen=True)
class MadeUpIncrement:
    """The part of an Increment that recording and result read, without a device."""

    number: int
    load_factor: float
    displacement: np.ndarray
    relaxation: Relaxation
    seconds: float

    @property
    def from_rest(self):
        return self.displacement.astype(np.float32)


def made_up_increments(trunk, count=3, status=None):
    """Increments as `simulate` would yield them, with displacements and energies that are known."""
    increments = []
    for number in range(1, count + 1):
        relaxation = Relaxation(
            status=status or RelaxStatus.CONVERGED,
            energy=Energy({"distance": 1.0 * number, "area": 2.0 * number, "volume": 3.0 * number}),
            steps=4,
            linear_iterations=50 * number,
            evaluations=6,
            estimated_error=0.004,
            inverted_tets=0,
        )
        load_factor = number / count
        displacement = turned(trunk, -14.0 * load_factor)
        increments.append(MadeUpIncrement(number, load_factor, displacement, relaxation, 0.25))
    return increments


def start_recording(path, case, trunk, **options):
    """A recording of a case that has no increment yet."""
    if case.has_spine:
        path_of_bones = spline_path(trunk.nodes, case.landmarks_before, case.landmarks_after)
    else:
        path_of_bones = rigid_path(trunk, motions_of(case))
    before = measure(case.skin, case.landmarks_before)
    actual = None if case.actual_skin is None else measure(case.actual_skin, case.landmarks_after)
    recording = Recording(path, case, trunk, before, actual, path_of_bones, **options)
    rr.set_strict_mode(True)  # raise where Rerun would only warn
    return recording


def measured(case, trunk, increment):
    """Measures of a case at an increment."""
    skin = predicted_skin(case, trunk, increment.displacement)
    return measure(skin, case.landmarks_at(increment.load_factor), case.skin)


APEX = "T7"
"""Of its right thoracic curve of 40 degrees, T4 to T11."""


def curved_case() -> Case:
    """A box of tissue with the landmarks of a curved spine; of its bones only a vertebra and a rib are drawn."""
    _, skin = small_trunk()
    bones = {
        name: Surface(skin.vertices * 0.05 + [0.0, 20.0, height], skin.faces)
        for name, height in (("T8", 200.0), ("rib_left_08", 180.0))
    }
    return Case('curved "<i>box</i>"', skin, bones, before_and_after()[0])


def small_patient(**options: Any) -> PreparedPatient:
    """It, made ready on one CPU thread."""
    trunk = replace(small_trunk()[0], bone_names=("T8",))
    return patient_of(curved_case(), RunOptions(**options), trunk, execution=Execution(device="cpu", threads=1))
