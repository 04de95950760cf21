"""The model of one trunk on one device: the only upload, constant for a patient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from .errors import InputError
from .ordering import bisect
from .parallel import Parallel
from .tissue import Tissue
from .trunk_mesh import TrunkMesh

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""Corners of a tetrahedron's edges."""
FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""Corners of a tetrahedron's faces; face k lies opposite corner k."""
PRECISIONS = {"float32": wp.float32, "float64": wp.float64}


@dataclass(frozen=True)
class Model:
    """Rest measures and weights of every tetrahedron. Free nodes come first in every array."""

    parallel: Parallel
    """Where the kernels run."""
    scalar: Any
    """Precision of the device arrays, wp.float32 or wp.float64."""
    tissue: Tissue
    """The constants the model was built with."""
    gravity: float
    """Gravity [m/s^2], downward; 0 leaves the term out."""
    alpha: float
    """2 g M_0 H_0 / k_D of eq. 4.6, from gravity, density and Young's modulus."""
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
    rest_edge: wp.array
    """Vectors from corner 0 to corners 1, 2, 3 at rest [mm], shape (tets, 3)."""
    rest_length: wp.array
    """Edge lengths at rest [mm], shape (tets,), vec6, order 01 02 03 12 13 23."""
    rest_area: wp.array
    """Face areas at rest [mm^2], shape (tets,), vec4; face k lies opposite corner k."""
    rest_volume: wp.array
    """Volumes at rest [mm^3], shape (tets,)."""
    edge_weight: wp.array
    """1 / |K_ij| of eq. 4.8, shape (tets,), vec6."""
    face_weight: wp.array
    """epsilon / |K_ijk| of eq. 4.9, shape (tets,), vec4; empty with epsilon 0."""
    gravity_per_volume: float
    """Energy for each mm^3 of a tetrahedron and mm of height of a corner: alpha m_i / (M_0 H_0 V_T)."""
    gravity_at_rest: float
    """The gravity term of the trunk before surgery, which the displacement's part adds to."""

    @property
    def precision(self) -> str:
        """'float32' or 'float64'."""
        return "float32" if self.scalar is wp.float32 else "float64"

    @property
    def device(self) -> str:
        """'cpu' or 'cuda:N'."""
        return self.parallel.device

    @property
    def elements(self) -> list[Any]:
        """The tetrahedra, as the first arguments of every kernel over them."""
        return [
            self.tets,
            self.rest_edge,
            self.rest_length,
            self.rest_area,
            self.rest_volume,
            self.edge_weight,
            self.face_weight,
            self.scalar(self.tissue.theta),
        ]

    @property
    def vec3(self) -> Any:
        """Vector type of positions in the model's precision."""
        return wp.types.vector(3, self.scalar)

    @property
    def variant(self) -> tuple[Any, bool]:
        """Which build of the kernels it needs: precision, and whether for CUDA."""
        return self.scalar, self.parallel.is_cuda

    @property
    def terms(self) -> tuple[bool, bool, bool]:
        """Which of the area, volume and gravity terms the scene uses."""
        return self.tissue.epsilon > 0.0, self.tissue.theta > 0.0, self.gravity != 0.0

    def array(self, values: np.ndarray | None, dtype: Any, shape: tuple[int, ...] | None = None) -> wp.array:
        """A device array of the values, or of zeros."""
        if values is None:
            return wp.zeros(shape, dtype=dtype, device=self.device)
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)


def build_model(
    trunk: TrunkMesh,
    tissue: Tissue | None = None,
    *,
    gravity: float = 0.0,
    device: str = "auto",
    precision: str = "float32",
    threads: int = 0,
) -> Model:
    """Measures the trunk at rest and uploads it.

    Args:
        trunk: the mesh before surgery.
        tissue: constants of the energy; the default tissue if left out.
        gravity: acceleration [m/s^2]; 0 leaves the term out of the kernels.
        device: 'auto', 'cpu' or 'cuda:N'.
        precision: 'float32' or 'float64', of the device arrays; the host measures in float64.
        threads: CPU threads; 0 is all cores.

    Raises:
        InputError: an argument out of its range, no tetrahedron, a tetrahedron without volume at rest,
            or a piece of free tissue that no bone holds.
    """
    tissue = tissue or Tissue()
    if precision not in PRECISIONS:
        raise InputError(f"precision: must be float32 or float64, not '{precision}'")
    if not np.isfinite(gravity):
        raise InputError(f"gravity: must be a finite acceleration in m/s^2, not {gravity}")
    check_mesh(trunk)
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
    corners = corners[np.argsort(corners.min(axis=1), kind="stable")]
    rest = trunk.nodes[order]

    p = rest[corners]
    rest_edge = p[:, 1:] - p[:, :1]
    rest_volume = np.einsum("ij,ij->i", rest_edge[:, 0], np.cross(rest_edge[:, 1], rest_edge[:, 2])) / 6.0
    rest_length = np.linalg.norm(p[:, EDGES[:, 1]] - p[:, EDGES[:, 0]], axis=2)
    rest_area = face_areas(p)
    alpha, gravity_per_volume = gravity_weights(tissue, gravity, rest, corners, rest_volume)
    heights = p[:, :, 2].sum(axis=1)

    def upload(values: np.ndarray, dtype: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=parallel.device)

    vec4, vec6 = wp.types.vector(4, scalar), wp.types.vector(6, scalar)
    return Model(
        parallel=parallel,
        scalar=scalar,
        tissue=tissue,
        gravity=gravity,
        alpha=alpha,
        order=order,
        free=len(free_nodes),
        rest=rest,
        corners=corners,
        tets=upload(corners, wp.vec4i),
        rest_edge=upload(rest_edge, wp.types.vector(3, scalar)),
        rest_length=upload(rest_length, vec6),
        rest_area=upload(rest_area if tissue.epsilon > 0.0 else rest_area[:0], vec4),
        rest_volume=upload(rest_volume, scalar),
        edge_weight=upload(1.0 / shared_by(corners[:, EDGES]), vec6),
        face_weight=upload(
            tissue.epsilon / shared_by(corners[:, FACES]) if tissue.epsilon > 0.0 else rest_area[:0], vec4
        ),
        gravity_per_volume=gravity_per_volume,
        gravity_at_rest=gravity_per_volume * float(rest_volume @ heights),
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


def face_areas(p: np.ndarray) -> np.ndarray:
    """Areas of the four faces of tetrahedra with corners p (tets, 4, 3), shape (tets, 4)."""
    q = p[:, FACES]
    return 0.5 * np.linalg.norm(np.cross(q[:, :, 1] - q[:, :, 0], q[:, :, 2] - q[:, :, 0]), axis=2)


def shared_by(features: np.ndarray) -> np.ndarray:
    """For every edge or face of every tetrahedron (tets, features, corners): in how many it occurs."""
    flat = np.sort(features.reshape(-1, features.shape[2]), axis=1).astype(np.int64)
    key = flat[:, 0]
    for column in range(1, flat.shape[1]):
        key = key * (int(features.max()) + 1) + flat[:, column]
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    return counts[inverse].reshape(features.shape[:2])


def gravity_weights(
    tissue: Tissue, gravity: float, rest: np.ndarray, corners: np.ndarray, rest_volume: np.ndarray
) -> tuple[float, float]:
    """alpha of eq. 4.6 and the weight of gravity per mm^3 and mm.

    k_D [J] follows from Young's modulus: edges of energy k_D/2 s^2 that point every way give a bar
    of volume V the energy (k_D/2) N s^2 / 5 at uniaxial strain s, which a continuum gives as
    E V s^2 / 2, so k_D = 5 E V / N for N edges in the volume V. That makes the sag of the tissue
    depend on its modulus and not on the size of the tetrahedra.
    """
    if gravity == 0.0:
        return 0.0, 0.0
    edges = np.unique(np.sort(corners[:, EDGES].reshape(-1, 2), axis=1), axis=0)
    volume_m3 = rest_volume.sum() * 1e-9
    k_d = 5.0 * tissue.youngs_modulus * 1e3 * volume_m3 / len(edges)
    mean_mass = tissue.density * volume_m3 / len(corners)
    height_m = (rest[:, 2].max() - rest[:, 2].min()) * 1e-3
    alpha = 2.0 * gravity * mean_mass * height_m / k_d
    quarter_mass_per_mm3 = 0.25 * tissue.density * 1e-9
    return alpha, alpha * quarter_mass_per_mm3 / mean_mass / (height_m * 1e3)
