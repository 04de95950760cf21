"""The benchmarked problem: one file that holds a mesh, the motion of its bones and where it ends.

It is read with numpy and scipy alone, so that a machine without the meshing libraries can run the benchmark.
"""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from warp_trunk import InputError, Landmarks, Surface, Tissue
from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion, RigidBones, spline_path
from warp_trunk.engine.build import build_model
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.measures import back_surface_rotation

TRUTH_TOLERANCE = 1e-6
"""Estimated distance from equilibrium of the solution that errors are measured against [mm]."""
_MESH = tuple(field.name for field in fields(TrunkMesh) if field.name != "tissue")
_TISSUE = tuple(field.name for field in fields(Tissue))


@dataclass(frozen=True)
class Errors:
    """How far a trunk is from another, or from the truth."""

    max_error_mm: float
    """Largest distance of a node [mm]; of a skin vertex where only skins are compared."""
    mean_skin_error_mm: float
    """Mean distance of a skin vertex [mm]."""
    bsr_error_deg: float
    """Largest difference of the back surface rotation of any level [degrees]."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A trunk and a planned correction, meshed."""

    name: str
    """Its name in tables."""
    trunk: TrunkMesh
    """The mesh before surgery."""
    tissue: Tissue
    """Constants of the energy."""
    landmarks_before: Landmarks
    """Points on the bones before surgery."""
    landmarks_after: Landmarks
    """The same points after surgery."""
    energy: EnergyName = "itmsm"
    """Which energy the tissue has."""
    skin_rigidity: float = 0.0
    """Flexural rigidity of the skin [N mm]."""
    path: PrescribedMotion | None = None
    """The motion of bones that follow, each rigidly; the spline of the landmarks where there is none."""
    truth: np.ndarray | None = None
    """Displacement after surgery in float64, converged to TRUTH_TOLERANCE [mm], shape (nodes, 3)."""

    def bone_path(self) -> PrescribedMotion:
        """The motion of the bones."""
        return self.path or spline_path(self.trunk.nodes, self.landmarks_before, self.landmarks_after)

    def skin(self, displacement: np.ndarray) -> Surface:
        """The skin at a displacement of the nodes (nodes, 3) [mm]."""
        at = self.trunk.skin_nodes
        return Surface(self.trunk.nodes[at] + displacement[at], self.trunk.skin_faces)

    def errors(self, displacement: np.ndarray) -> Errors:
        """Distance of a displacement (nodes, 3) from the truth."""
        if self.truth is None:
            raise InputError(f"{self.name}: the problem holds no truth; prepare it without --no-truth")
        distance = np.linalg.norm(displacement - self.truth, axis=1)
        skins = compare_skins(self.skin(displacement), self.skin(self.truth), self.landmarks_after)
        return Errors(float(distance.max()), skins.mean_skin_error_mm, skins.bsr_error_deg)


def compare_skins(skin: Surface, other: Surface, landmarks: Landmarks) -> Errors:
    """Distance of two skins with the same vertices, and the difference of their rotations."""
    distance = np.linalg.norm(skin.vertices - other.vertices, axis=1)
    bsr, other_bsr = (back_surface_rotation(surface, landmarks) for surface in (skin, other))
    differences = [
        abs(tangent.angle - same.angle)
        for level, tangent in bsr.items()
        if tangent is not None and (same := other_bsr[level]) is not None
    ]
    return Errors(float(distance.max()), float(distance.mean()), max(differences, default=float("nan")))


def solve_truth(problem: Problem) -> np.ndarray:
    """The equilibrium in float64 to TRUTH_TOLERANCE, shape (nodes, 3) [mm]."""
    model = build_model(
        problem.trunk,
        problem.tissue,
        Physics(energy=problem.energy, skin_rigidity=problem.skin_rigidity),
        device="cpu",
        precision="float64",
    )
    relax = RelaxOptions(method="newton", tolerance=TRUTH_TOLERANCE)
    *_, last = simulate(model, problem.bone_path(), SimulationOptions(relax=relax))
    if last.relaxation.status is not RelaxStatus.CONVERGED:
        raise InputError(f"{problem.name}: no truth to measure against, {last.relaxation.status.sentence}")
    return last.displacement


def write_problem(path: str | Path, problem: Problem) -> None:
    """Writes a problem as a compressed npz without pickle."""
    trunk, tissue = problem.trunk, problem.tissue
    arrays = {name: np.asarray(getattr(trunk, name)) for name in _MESH if name != "bone_names"}
    arrays["bone_names"] = np.array(trunk.bone_names, dtype=str)
    arrays["name"] = np.array(problem.name)
    arrays["energy"] = np.array(problem.energy)
    arrays["tissue"] = np.array([getattr(tissue, name) for name in _TISSUE])
    arrays["landmark_names"] = np.array(problem.landmarks_before.names, dtype=str)
    arrays["landmarks_before"] = problem.landmarks_before.points
    arrays["landmarks_after"] = problem.landmarks_after.points
    arrays["skin_rigidity"] = np.array(problem.skin_rigidity)
    if problem.path is not None and (rigid := problem.path.rigid_bones) is not None:
        arrays["path"] = problem.path.displacement
        arrays |= {f"rigid_{name}": value for name, value in vars(rigid).items()}
    if problem.truth is not None:
        arrays["truth"] = problem.truth
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:  # a file, because numpy would add .npz to another name
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_problem(path: str | Path) -> Problem:
    """Reads what `write_problem` wrote.

    Raises:
        InputError: no such file, or not one of these.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            stored = {name: file[name] for name in file.files}
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a problem ({error}); make one with 'prepare'") from error
    missing = sorted({"name", "energy", "skin_rigidity", "tissue", "landmark_names", *_MESH} - set(stored))
    if missing:
        raise InputError(f"{path}: '{missing[0]}' is missing; make the file again with 'prepare'")
    mesh = {name: stored[name] for name in _MESH if name != "bone_names"}
    names = tuple(str(name) for name in stored["landmark_names"])
    energy: EnergyName = str(stored["energy"])  # pyright: ignore[reportAssignmentType]  (build_model checks it)
    return Problem(
        name=str(stored["name"]),
        trunk=TrunkMesh(**mesh, bone_names=tuple(str(name) for name in stored["bone_names"])),
        tissue=Tissue(**dict(zip(_TISSUE, map(float, stored["tissue"]), strict=True))),
        landmarks_before=Landmarks(names, stored["landmarks_before"]),
        landmarks_after=Landmarks(names, stored["landmarks_after"]),
        energy=energy,
        skin_rigidity=float(stored["skin_rigidity"]),
        path=_path(stored),
        truth=stored.get("truth"),
    )


def _path(stored: dict[str, np.ndarray]) -> PrescribedMotion | None:
    """The motion of bones that follow, where it is stored."""
    if "path" not in stored:
        return None
    rigid = {field.name: stored[f"rigid_{field.name}"] for field in fields(RigidBones)}
    return PrescribedMotion(stored["path"], RigidBones(**rigid))
