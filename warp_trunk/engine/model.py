"""The model of one trunk on one device: the only upload, constant for a patient."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from .parallel import CUDA_BLOCK, Launch, Parallel

if TYPE_CHECKING:
    from .energies.energy import TetEnergy
    from .skin import Skin
    from .tissue import Tissue
    from .topology import Edges


@dataclass(frozen=True)
class Model:
    """A trunk at rest and what its energy reads of it.

    It alone knows how nodes are numbered: the free ones first, then the prescribed ones, so that both are a
    range of every array and a launch over the free nodes moves no prescribed one (the mappings U of eq. 4.3 of
    [2]). Everything else asks for `free`, `prescribed` or a launch `over_free`.
    """

    parallel: Parallel
    """Where the kernels run."""
    scalar: Any
    """Precision of the device arrays, wp.float32 or wp.float64."""
    tissues: tuple[Tissue, ...]
    """The constants the model was built with; the mesh labels its tetrahedra with their numbers."""
    gravity: float
    """Gravity [m/s^2], downward; 0 leaves the term out."""
    order: np.ndarray
    """The mesh node of each model node, shape (nodes,)."""
    tet_order: np.ndarray
    """The mesh tetrahedron of each model tetrahedron, shape (tets,)."""
    free_nodes: int
    """Number of free nodes."""
    rest: np.ndarray
    """Positions at rest in model order [mm], shape (nodes, 3), float64, on the host."""
    corners: np.ndarray
    """Nodes of the tetrahedra in model numbers, shape (tets, 4), int32, on the host."""
    tets: wp.array
    """The same on the device, shape (tets,), vec4i."""
    elements: TetEnergy
    """Data of every tetrahedron for the energy, on the device, and its kernels."""
    edges: Edges
    """Which nodes share a term: corners of the tetrahedra, then of the hinges of the skin."""
    in_precision: Callable[[str], Model] = field(repr=False)
    """Makes the same trunk in 'float32' or 'float64'."""
    released: Callable[[np.ndarray], Model] = field(repr=False)
    """Makes the same trunk with prescribed nodes free, given by their mesh numbers; these follow the other free
    ones, so that no free node gets another number."""
    label: np.ndarray | None = None
    """The tissue of each tetrahedron in model order, or the parts of all, as in `RestMesh`."""
    scan: np.ndarray | None = None
    """Displacement from rest of the trunk before surgery, in model order [mm], shape (nodes, 3), 0 on bone; None
    where the trunk before surgery is at rest."""
    skin: Skin | None = None
    """The skin as a thin plate; None where it resists no bending."""

    @property
    def precision(self) -> str:
        """'float32' or 'float64'."""
        return "float32" if self.scalar is wp.float32 else "float64"

    @property
    def device(self) -> str:
        """'cpu' or 'cuda:N'."""
        return self.parallel.device

    @property
    def vec3(self) -> Any:
        """Vector type of positions in the model's precision."""
        return wp.types.vector(3, self.scalar)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.order)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms of its energy, in the order in which they are added."""
        return (*self.elements.terms, *["bending"] * (self.skin is not None))

    @property
    def free(self) -> slice:
        """The free nodes, which relaxation moves, in every array over the nodes."""
        return slice(0, self.free_nodes)

    @property
    def prescribed(self) -> slice:
        """The nodes on bone, which surgery moves and relaxation holds."""
        return slice(self.free_nodes, self.nodes)

    def over_free(self, kernel: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
        """Records a launch over the free nodes; see `Parallel.record`."""
        return self.parallel.record(kernel, self.free_nodes, inputs, outputs)

    def over_tets(
        self, kernel: Any, inputs: Sequence[Any], outputs: Sequence[Any], block: int = CUDA_BLOCK
    ) -> Launch:
        """Records a launch of a kernel of the energy, which takes its arrays first; see `Parallel.record`."""
        return self.parallel.record(
            kernel, len(self.corners), [self.tets, self.elements.arrays, *inputs], outputs, block=block
        )

    def over_hinges(
        self, name: str, inputs: Sequence[Any], outputs: Sequence[Any], block: int = CUDA_BLOCK
    ) -> list[Launch]:
        """Records a launch of a kernel of the skin's, by its name, over its hinges; none without."""
        if self.skin is None:
            return []
        kernel = getattr(self.skin.kernels, name)
        arguments = [*self.skin.arguments, *inputs]
        return [self.parallel.record(kernel, len(self.skin.corners), arguments, outputs, block=block)]

    def array(self, values: np.ndarray, dtype: Any) -> wp.array:
        """The values on the device."""
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def zeros(self, dtype: Any, *shape: int) -> Any:
        """A device array of zeros."""
        return wp.zeros(shape, dtype=dtype, device=self.device)

    def free_vectors(self) -> wp.array:
        """Zero vectors of the free nodes, shape (free nodes,), vec3."""
        return self.zeros(self.vec3, self.free_nodes)

    def scanned(self) -> wp.array:
        """Displacement from rest of the trunk before surgery [mm], shape (nodes,), vec3."""
        return self.zeros(self.vec3, self.nodes) if self.scan is None else self.array(self.scan, self.vec3)
