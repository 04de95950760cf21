"""FEniCSx: compiled forms, PETSc's solvers, as many MPI processes as there are cores.

Written for FEniCSx 0.5 (Debian 12) and its Python, which has no warp_trunk: only NumPy and what stands beside it.
"""

# pyright: reportMissingImports=false
# (FEniCSx is Debian's, not of the environment that is checked)

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from finite_elements.motions import rigid_motions
from finite_elements.neo_hookean import NeoHookean
from mpi4py import MPI
from petsc4py import PETSc

from .task import Task
from .timing import TIGHT, Peer, main

COMPILER = {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]}
MOST_STEPS = 30
MULTIGRID = {"ksp_type": "cg", "ksp_rtol": 1e-2, "ksp_norm_type": "unpreconditioned", "pc_type": "gamg"}
GAMG = {
    **MULTIGRID,
    "pc_gamg_reuse_interpolation": True,
    "pc_gamg_threshold": 0.01,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
    "mg_levels_esteig_ksp_max_it": 10,
}
WAYS: dict[str, dict[str, Any]] = {
    "GAMG, CG to 1e-2": GAMG,
    "GAMG, CG to 1e-3": {**GAMG, "ksp_rtol": 1e-3},
    "hypre BoomerAMG, CG to 1e-2": {
        **MULTIGRID,
        "pc_type": "hypre",
        "pc_hypre_boomeramg_strong_threshold": 0.5,
        "pc_hypre_boomeramg_coarsen_type": "HMIS",
        "pc_hypre_boomeramg_interp_type": "ext+i",
        "pc_hypre_boomeramg_agg_nl": 1,
    },
}
COMM = MPI.COMM_WORLD


class _Made:
    """A distributed mesh with its forms, matrix and preconditioner at rest."""

    def __init__(self, task: Task, options: dict[str, Any]) -> None:
        self.task = task
        self._space(task)
        self._forms(task)
        self.A = fem.petsc.create_matrix(self.stiffness)
        self.A.setNearNullSpace(_rigid_motions(self.space, self.places))
        self.b, self.step = fem.petsc.create_vector(self.forces), fem.petsc.create_vector(self.forces)
        self.ksp = PETSc.KSP().create(COMM)
        prefix = f"peer_{id(self)}_"
        for name, value in options.items():
            PETSc.Options()[prefix + name] = value
        self.ksp.setOptionsPrefix(prefix)
        self.ksp.setOperators(self.A)
        self.ksp.setFromOptions()
        self._assemble()
        self.ksp.setUp()

    def _space(self, task: Task) -> None:
        """The mesh over all processes, and which node of the task each of their nodes is."""
        shape = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.tetrahedron, 1))
        mine = partial(np.array_split, indices_or_sections=COMM.size)
        cells, points = mine(task.tets.astype(np.int64))[COMM.rank], mine(task.nodes)[COMM.rank]
        mesh = dolfinx.mesh.create_mesh(COMM, cells, points, shape)
        self.space = fem.VectorFunctionSpace(mesh, ("Lagrange", 1))
        index_map = self.space.dofmap.index_map
        self.owned = index_map.size_local
        self.original = np.empty(self.owned + index_map.num_ghosts, dtype=np.int64)
        at = np.asarray(mesh.geometry.input_global_indices)[mesh.geometry.dofmap.array]
        self.original[self.space.dofmap.list.array] = at
        self.places = task.nodes[self.original[: self.owned]]

    def _forms(self, task: Task) -> None:
        """The same strain energy with one point in each tetrahedron, its derivatives, and the held nodes."""
        self.u = fem.Function(self.space)
        law = NeoHookean(task.youngs_modulus, task.poisson_ratio)
        F = ufl.Identity(3) + ufl.grad(self.u)
        squares, volume = ufl.inner(F, F), ufl.det(F)
        density = 0.5 * law.mu * (squares - 3.0) + 0.5 * law.lam * (volume - law.alpha) ** 2
        missing = ufl.max_value(0.5 - volume, 0.0)
        bent = ufl.min_value(missing, law.parabola)
        over = missing - bent
        density += law.lam * law.crush / 4.0 * bent**2 * (bent**2 + 4.0 * bent * over + 6.0 * over**2)
        energy = (density - 0.5 * law.mu * ufl.ln(squares + 1.0)) * ufl.dx(metadata={"quadrature_degree": 0})
        forces = ufl.derivative(energy, self.u)
        self.forces = fem.form(forces, jit_params=COMPILER)
        self.stiffness = fem.form(ufl.derivative(forces, self.u), jit_params=COMPILER)
        held = np.flatnonzero(task.held[self.original]).astype(np.int32)
        self.bcs = [fem.dirichletbc(np.zeros(3), held, self.space)]

    def _assemble(self) -> None:
        self.A.zeroEntries()
        fem.petsc.assemble_matrix(self.A, self.stiffness, self.bcs)
        self.A.assemble()

    def solve(self, enough: Callable[[Any], bool] | None) -> dict[str, float]:
        """Newton's method from the spline's image."""
        if enough is None:
            self.ksp.setTolerances(rtol=1e-6)
        self.u.x.array[:] = self.task.image[self.original].ravel()
        steps = iterations = 0
        while steps < MOST_STEPS:
            steps += 1
            self._assemble()
            with self.b.localForm() as local:
                local.set(0.0)
            fem.petsc.assemble_vector(self.b, self.forces)
            self.b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            fem.petsc.set_bc(self.b, self.bcs)
            self.ksp.setOperators(self.A)
            self.ksp.solve(self.b, self.step)
            iterations += self.ksp.getIterationNumber()
            moved = self.step.array
            self.u.x.array[: len(moved)] -= moved
            self.u.x.scatter_forward()
            if enough(self) if enough else self._largest(moved.reshape(-1, 3)) <= TIGHT:
                break
        return {"steps": steps, "linear_iterations": iterations}

    def _largest(self, arrows: np.ndarray) -> float:
        """The longest arrow of all processes."""
        longest = float(np.linalg.norm(arrows, axis=1).max())
        return COMM.allreduce(longest if np.isfinite(longest) else np.inf, MPI.MAX)

    def error(self) -> float:
        """Largest distance of a node from the truth [mm]."""
        found = self.u.x.array[: 3 * self.owned].reshape(-1, 3)
        return self._largest(found - self.task.truth[self.original[: self.owned]])

    def displacement(self) -> np.ndarray | None:
        """Of all nodes, on the first process."""
        parts = COMM.gather((self.original[: self.owned], self.u.x.array[: 3 * self.owned].copy()))
        if parts is None:
            return None
        displacement = np.empty_like(self.task.nodes)
        for original, found in parts:
            displacement[original] = found.reshape(-1, 3)
        return displacement


def _rigid_motions(space: Any, places: np.ndarray) -> Any:
    """The motions at rest, orthonormal, which smoothed aggregation is told of."""
    index_map, bs = space.dofmap.index_map, space.dofmap.index_map_bs
    vectors = []
    for motion in rigid_motions(places).T:
        vector = PETSc.Vec().createMPI(
            (index_map.size_local * bs, index_map.size_global * bs), bsize=bs, comm=COMM
        )
        vector.array = motion
        for other in vectors:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
        vectors.append(vector)
    return PETSc.NullSpace().create(vectors=vectors, comm=COMM)


def make(task: Task) -> Peer:
    """The peer."""
    version = f"FEniCSx {dolfinx.__version__}, PETSc {'.'.join(map(str, PETSc.Sys.getVersion()))}"
    ways: dict[str, Callable[[], Any]] = {way: partial(_Made, task, options) for way, options in WAYS.items()}
    return Peer(version, ways, _Made.solve, _Made.error, _Made.displacement)


def of_first(decision: bool) -> bool:
    """The first process decides for all."""
    return COMM.bcast(bool(decision))


if __name__ == "__main__":
    main(make, of_first, writes=COMM.rank == 0)
