"""The model of one trunk on one device: the only upload, constant for a patient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import warp as wp

from warp_trunk.errors import InputError

from .energies.itmsm import Itmsm, make_itmsm
from .energies.neo_hookean import NeoHookean, make_neo_hookean
from .ordering import bisect
from .parallel import Parallel
from .rest_mesh import RestMesh
from .tissue import Tissue
from .trunk_mesh import TrunkMesh

PRECISIONS = {"float32": wp.float32, "float64": wp.float64}
EnergyName = Literal["itmsm", "neo-hookean"]
WeightsName = Literal["count", "volume"]


@dataclass(frozen=True)
class Model:
    """A trunk at rest and what its energy reads of it. Free nodes come first in every array."""

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
    free: int
    """Number of free nodes; the prescribed ones follow."""
    rest: np.ndarray
    """Positions at rest in model order [mm], shape (nodes, 3), float64, on the host."""
    corners: np.ndarray
    """Nodes of the tetrahedra in model numbers, shape (tets, 4), int32, on the host."""
    tets: wp.array
    """The same on the device, shape (tets,), vec4i."""
    elements: Itmsm | NeoHookean
    """What the energy reads of every tetrahedron, on the device, and its kernels."""
    scan: np.ndarray | None = None
    """Displacement from rest of the trunk before surgery, in model order [mm], shape (nodes, 3), 0 on bone; None
    where the trunk before surgery is at rest."""

    @property
    def precision(self) -> str:
        """'float32' or 'float64'."""
        return "float32" if self.scalar is wp.float32 else "float64"

    @property
    def device(self) -> str:
        """'cpu' or 'cuda:N'."""
        return self.parallel.device

    @property
    def tissue(self) -> Tissue:
        """The first tissue, the only one of a uniform trunk."""
        return self.tissues[0]

    @property
    def vec3(self) -> Any:
        """Vector type of positions in the model's precision."""
        return wp.types.vector(3, self.scalar)

    @property
    def variant(self) -> tuple[Any, bool]:
        """Which build of the kernels it needs: precision, and whether for CUDA."""
        return self.scalar, self.parallel.is_cuda

    def array(self, values: np.ndarray | None, dtype: Any, shape: tuple[int, ...] | None = None) -> wp.array:
        """A device array of the values, or of zeros."""
        if values is None:
            return wp.zeros(shape, dtype=dtype, device=self.device)
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)


def build_model(
    trunk: TrunkMesh,
    tissue: Tissue | Sequence[Tissue] | None = None,
    *,
    energy: EnergyName = "itmsm",
    weights: WeightsName = "count",
    gravity: float = 0.0,
    device: str = "auto",
    precision: str = "float32",
    threads: int = 0,
) -> Model:
    """Measures the trunk at rest and uploads it.

    Args:
        trunk: the mesh before surgery.
        tissue: constants of the energy; the default tissue if left out. Of several, `trunk.tissue` says which
            a tetrahedron is made of, or which part of it.
        energy: 'itmsm', the energy itmsm (eq. 4.6 of [2]), or 'neo-hookean', a continuum (stable neo-Hookean).
        weights: how itmsm weights its features: by their 'count' (the papers) or by rest 'volume'.
        gravity: acceleration [m/s^2]; 0 leaves the term out of the kernels.
        device: 'auto', 'cpu' or 'cuda:N'.
        precision: 'float32' or 'float64', of the device arrays; the host measures in float64.
        threads: CPU threads; 0 is all cores.

    Raises:
        InputError: an argument out of its range, no tetrahedron, a tetrahedron without volume at rest or of a
            tissue that is not given, or a piece of free tissue that no bone holds.
    """
    tissues = (tissue or Tissue(),) if isinstance(tissue, Tissue | None) else tuple(tissue)
    check_choice("precision", precision, tuple(PRECISIONS))
    check_choice("energy", energy, get_args(EnergyName))
    check_choice("weights", weights, get_args(WeightsName))
    if weights != "count" and energy != "itmsm":
        raise InputError(f"weights: '{weights}' is a choice of the energy itmsm; leave it out with {energy}")
    if not np.isfinite(gravity):
        raise InputError(f"gravity: must be a finite acceleration in m/s^2, not {gravity}")
    check_mesh(trunk)
    check_tissues(trunk, tissues)
    parallel = Parallel(device, threads)
    scalar = PRECISIONS[precision]

    prescribed = trunk.prescribed
    free_nodes = np.flatnonzero(~prescribed)
    order = np.concatenate(
        [free_nodes[bisect(trunk.nodes[free_nodes], max(1, len(free_nodes) // 8))[0]], np.flatnonzero(prescribed)]
    )
    number = np.empty(len(order), dtype=np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    corners = number[trunk.tets]
    tet_order = np.argsort(corners.min(axis=1), kind="stable")
    corners = corners[tet_order]
    label = trunk.tissue[tet_order] if trunk.tissue is not None and len(tissues) > 1 else None
    rest = RestMesh(trunk.nodes[order], corners, tissues, label, scalar, parallel.device)
    if energy == "itmsm":
        elements = make_itmsm(rest, weights, gravity, parallel.is_cuda)
    else:
        elements = make_neo_hookean(rest, gravity, parallel.is_cuda)
    return Model(
        parallel=parallel,
        scalar=scalar,
        tissues=tissues,
        gravity=gravity,
        order=order,
        free=len(free_nodes),
        rest=rest.nodes,
        corners=corners,
        tets=rest.upload(corners, wp.vec4i),
        elements=elements,
    )


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """InputError where the value is none of the choices."""
    if value not in choices:
        raise InputError(f"{name}: must be {' or '.join(choices)}, not '{value}'")


def check_tissues(trunk: TrunkMesh, tissues: tuple[Tissue, ...]) -> None:
    """InputError where the tetrahedra's labels and the tissues do not fit together."""
    if not tissues:
        raise InputError("tissue: there is none; give one, or one for each label of the mesh")
    if trunk.tissue is None:
        if len(tissues) > 1:
            raise InputError(
                f"tissue: {len(tissues)} are given but the mesh does not say which tetrahedron is of which; "
                "label it (TrunkMesh.tissue) or give one tissue"
            )
        return
    if trunk.tissue.ndim == 2:
        if trunk.tissue.shape[1] != len(tissues):
            raise InputError(
                f"tissue: the mesh has parts of {trunk.tissue.shape[1]} tissues but {len(tissues)} are given; "
                "give one tissue for each"
            )
        return
    most = int(trunk.tissue.max())
    if trunk.tissue.min() < 0 or most >= len(tissues) > 1:
        raise InputError(
            f"tissue: the mesh has labels from {trunk.tissue.min()} to {most} but {len(tissues)} tissues are "
            "given; give one tissue for each label from 0"
        )


def check_mesh(trunk: TrunkMesh) -> None:
    """InputError where the trunk cannot be a rest state, before anything is uploaded."""
    if len(trunk.tets) == 0:
        raise InputError("trunk: the mesh has no tetrahedron; give a mesh with soft tissue")
    if not np.isfinite(trunk.nodes).all():
        node = int(np.flatnonzero(~np.isfinite(trunk.nodes).all(axis=1))[0])
        raise InputError(f"trunk: node {node} is not finite ({trunk.nodes[node]}); mesh the trunk again")
    p = trunk.nodes[trunk.tets]
    edges = p[:, 1:] - p[:, :1]
    volume = np.einsum("ij,ij->i", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])) / 6.0
    worst = int(np.argmin(volume))
    if volume[worst] <= 0.0:
        raise InputError(
            f"trunk: tetrahedron {worst} has volume {volume[worst]:.3g} mm^3 at rest; "
            "every one needs a positive volume (check the order of its corners)"
        )
    loose = unheld_nodes(trunk)
    if loose:
        raise InputError(
            f"trunk: {loose} free nodes belong to tissue that no bone holds, so it could move rigidly; "
            "remove that piece or mark nodes of it as bone"
        )


def unheld_nodes(trunk: TrunkMesh) -> int:
    """Number of free nodes in connected pieces of tissue whose prescribed nodes leave a rigid motion free."""
    label = np.arange(len(trunk.nodes))
    while True:
        lowest = label[trunk.tets].min(axis=1)
        new = label.copy()
        np.minimum.at(new, trunk.tets.ravel(), np.repeat(lowest, 4))
        new = new[new]
        if np.array_equal(new, label):
            break
        label = new
    used = np.zeros(len(trunk.nodes), dtype=bool)
    used[trunk.tets] = True
    free_pieces = np.unique(label[~trunk.prescribed])
    unheld = [piece for piece in free_pieces if not holds(trunk.nodes[(label == piece) & trunk.prescribed & used])]
    return int((np.isin(label, unheld) & ~trunk.prescribed).sum())


def holds(points: np.ndarray) -> bool:
    """Whether fixing these points (n, 3) leaves no rigid motion: three of them not in line."""
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-6 * spread[0])
