"""From a case to a problem file; the only part of the benchmark that needs the meshing libraries."""

from dataclasses import replace

from warp_trunk import Case, RunOptions, phantom_case, read_case
from warp_trunk.meshing import MeshOptions, make_trunk
from warp_trunk.meshing.joints import free_joints
from warp_trunk.run.patient import find_path

from .problem import Problem

PHANTOM = "phantom"
"""The name that stands for the built-in phantom instead of a case folder."""


def load_case(name: str) -> Case:
    """The case in a folder, or the phantom."""
    return phantom_case() if name == PHANTOM else read_case(name)


def mesh_case(case: Case, tets: int, bone_edge_length: float = 0.0) -> Problem:
    """The problem of a case with about so many tetrahedra, its mesh from the cache where there; without truth.

    Raises:
        InputError: the surfaces force more tetrahedra than that.
    """
    trunk = make_trunk(case.skin, case.bones, MeshOptions(tets=tets, bone_edge_length=bone_edge_length)).trunk
    return Problem(case.name, trunk, case.tissue, case.landmarks_before, case.planned_landmarks)


def as_simulated(problem: Problem, case: Case, options: RunOptions) -> Problem:
    """The problem of a case with the bones, the energy and the skin of these options."""
    problem = replace(problem, energy=options.energy_of_tissue, skin_rigidity=options.rigidity_of_skin)
    if options.bones == "spline":
        return problem
    trunk = free_joints(problem.trunk)
    return replace(problem, trunk=trunk, path=find_path(case, trunk, options))
