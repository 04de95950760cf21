"""Models of small trunks, their states, equilibria and Hessians, as most tests of the engine need them."""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from scipy.sparse import bsr_array
from warp_trunk.kernels.arguments import Items, filled
from warp_trunk.kernels.assembly import PAIRS, vec10i

from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.engine.build import build_model
from warp_trunk.engine.linear import BlockMatrix
from warp_trunk.engine.model import Model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.relaxation import Relaxation, RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate
from warp_trunk.engine.state import State
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .meshes import rotate, rotation


def split_launches(threads: int = 2) -> Parallel:
    """That many threads on every machine, and also the smallest launch in a range for each of them.

    So tiny meshes test the threads; and as each number of threads adds up in its own order, a test that rounding
    decides is the same on machines with more cores.
    """
    return Parallel("cpu", threads, least_split=1)


def model_of(trunk: TrunkMesh, tissue: Any = None, threads: int = 1, **options: Any) -> Model:
    """A model, by default of itmsm without a skin that resists bending, in float64 on one CPU thread."""
    options = {"device": split_launches(threads), "precision": "float64", **options}
    where = {name: options.pop(name) for name in ("device", "precision")}
    physics = Physics(**{"energy": "itmsm", "skin_rigidity": 0.0, **options})
    return build_model(trunk, tissue, physics, **where)


def evaluated(model: Model, displacement: np.ndarray) -> State:
    """The state of a model at a displacement of the nodes of its mesh (nodes, 3) [mm]."""
    state = State(model)
    state.set_displacement(displacement)
    state.evaluate()
    return state


def gradient_of(state: State) -> np.ndarray:
    """In the order of the mesh, shape (nodes, 3)."""
    gradient = np.empty((len(state.model.order), 3))
    gradient[state.model.order] = state.gradient.numpy()
    return gradient


def relax(model: Model, start: np.ndarray, **options: Any) -> tuple[Relaxation, np.ndarray]:
    """How a relaxation from a displacement ends, and where [mm]; options by name."""
    relaxer = Relaxer(model, RelaxOptions(**options))
    relaxer.state.set_displacement(start)
    return relaxer.relax(), relaxer.state.host_displacement()


def increments(model: Model, displacement: np.ndarray, count: int = 1, **options: Any) -> list[Increment]:
    """The increments of a simulation that leads the nodes on bone to their displacement; options by name."""
    path = PrescribedMotion(displacement)
    return list(simulate(model, path, SimulationOptions(increments=count, relax=RelaxOptions(**options))))


def settle(model: Model, displacement: np.ndarray, count: int = 1, **options: Any) -> Increment:
    """The last of the increments, which has converged."""
    last = increments(model, displacement, count, **options)[-1]
    assert last.relaxation.status is RelaxStatus.CONVERGED
    return last


def held_turned(trunk: TrunkMesh, degrees: float, shift: Any = 0.0, axis: Any = (0.0, 0.0, 1.0)) -> np.ndarray:
    """A start in which the nodes on bone are turned about their centroid and shifted; the others stay."""
    held = trunk.prescribed
    start = np.zeros_like(trunk.nodes)
    start[held] = rotate(trunk.nodes[held], degrees, axis) + shift - trunk.nodes[held]
    return start


def half_and_half(trunk: TrunkMesh) -> TrunkMesh:
    """The same, with every other tetrahedron of a second tissue."""
    return replace(trunk, tissue=(np.arange(len(trunk.tets)) % 2).astype(np.int8))


def bent_and_noisy(trunk: TrunkMesh) -> np.ndarray:
    """A stretch and turn of some millimetres, and noise that inverts a few tetrahedra."""
    bend = trunk.nodes @ (1.1 * rotation(25.0, (1.0, 2.0, 0.5))).T - trunk.nodes
    return bend + np.random.default_rng(8).normal(scale=2.5, size=bend.shape)


def dense_hessian(model: Model, displacement: np.ndarray, name: str) -> np.ndarray:
    """Of the tetrahedra by the kernel of that name, over all nodes of the mesh, shape (3 nodes, 3 nodes)."""
    tets, nodes = len(model.corners), len(model.order)
    blocks = model.zeros(wp.types.matrix((3, 3), model.scalar), len(PAIRS) * tets)
    places, moved = model.array(places_apart(tets), vec10i), model.array(displacement[model.order], model.vec3)
    inputs = [filled(Items, end=tets), model.tets, model.elements.arrays, places, moved]
    wp.launch(getattr(model.elements.kernels, name), 1, inputs, [blocks], device="cpu")
    dense, numbers = np.zeros((3 * nodes, 3 * nodes)), 3 * model.order[model.corners][..., None] + np.arange(3)
    numbers = numbers.reshape(tets, 12)
    np.add.at(dense, (numbers[:, :, None], numbers[:, None, :]), element_matrices(blocks.numpy()))
    return dense


def differenced_gradient(model: Model, at: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Central differences of the gradient in every coordinate, shape (3 nodes, 3 nodes)."""
    moves = step * np.eye(at.size).reshape(-1, *at.shape)
    state, columns = State(model), []
    for move in moves:
        ends = []
        for moved in (at + move, at - move):
            state.set_displacement(moved)
            state.evaluate()
            ends.append(gradient_of(state).ravel())
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.array(columns)


def upper_blocks(matrix: BlockMatrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of the blocks on and above the diagonal, and the blocks, shape (blocks, 3, 3)."""
    row_start, columns = matrix.row_start.numpy(), matrix.columns.numpy()
    rows = np.searchsorted(row_start, np.arange(len(columns)), side="right") - 1
    upper = np.flatnonzero(columns >= rows)
    return rows[upper], columns[upper], matrix.blocks.numpy()[upper]


def on_host(matrix: BlockMatrix) -> bsr_array:
    """The whole matrix."""
    rows, columns, blocks = upper_blocks(matrix)
    start = np.searchsorted(rows, np.arange(matrix.model.free_nodes + 1))
    above = bsr_array((np.where((columns > rows)[:, None, None], blocks, 0.0), columns, start))
    return bsr_array((blocks, columns, start)) + above.T


def element_matrices(blocks: np.ndarray) -> np.ndarray:
    """The matrices of stencils, shape (stencils, 12, 12), by their blocks of `PAIRS`, one after the other."""
    matrices = np.empty((len(blocks) // len(PAIRS), 4, 4, 3, 3))
    for k, (a, b) in enumerate(PAIRS):
        matrices[:, a, b] = blocks[k :: len(PAIRS)]
        matrices[:, b, a] = matrices[:, a, b].transpose(0, 2, 1)
    return matrices.transpose(0, 1, 3, 2, 4).reshape(-1, 12, 12)


def places_apart(stencils: int) -> np.ndarray:
    """Where each block of stencils is added to a place of its own, shape (stencils, 10), int32."""
    return 2 * np.arange(len(PAIRS) * stencils, dtype=np.int32).reshape(-1, len(PAIRS))
