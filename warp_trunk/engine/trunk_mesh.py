"""The tetrahedral mesh of a trunk: what the engine simulates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError


@dataclass(frozen=True)
class TrunkMesh:
    """Soft tissue between bones and skin before surgery, from which every simulation of this patient starts."""

    nodes: np.ndarray
    """Positions before surgery [mm], shape (nodes, 3), float64."""
    tets: np.ndarray
    """Node indices, each of positive volume, shape (tets, 4), int32."""
    skin_nodes: np.ndarray
    """The mesh node of each vertex of the case's skin, in its order, shape (skin vertices,), int32."""
    skin_faces: np.ndarray
    """The case's skin triangles, in skin vertex numbers, shape (faces, 3), int32."""
    bone: np.ndarray
    """Index into bone_names of the bone a node lies on, -1 elsewhere, shape (nodes,), int32."""
    bone_names: tuple[str, ...]
    """Names of the bones, in the order of the case."""
    bone_faces: np.ndarray
    """Triangles of the bone surface, in node numbers, outward from the bone, shape (faces, 3), int32."""
    tissue: np.ndarray | None = None
    """Which tissue each tetrahedron is of, from 0, shape (tets,), int8, or which part of its volume is of each
    tissue, shape (tets, tissues), float64; None where all are of one."""

    @property
    def prescribed(self) -> np.ndarray:
        """True for nodes on bone, which surgery moves and relaxation holds; shape (nodes,)."""
        return self.bone >= 0


def check_trunk(trunk: TrunkMesh, name: str) -> None:
    """Checks that the parts of a mesh fit together and that every tetrahedron has a positive volume.

    Raises InputError whose text starts with `name`.
    """
    count = len(trunk.nodes)
    shapes = (
        ("nodes", trunk.nodes, (count, 3)),
        ("tets", trunk.tets, (len(trunk.tets), 4)),
        ("skin_nodes", trunk.skin_nodes, (len(trunk.skin_nodes),)),
        ("skin_faces", trunk.skin_faces, (len(trunk.skin_faces), 3)),
        ("bone", trunk.bone, (count,)),
        ("bone_faces", trunk.bone_faces, (len(trunk.bone_faces), 3)),
    )
    for field, array, shape in shapes:
        if array.shape != shape:
            raise InputError(f"{name}: '{field}' must have shape {shape}, not {array.shape}; mesh again")
    if len(trunk.tets) == 0:
        raise InputError(f"{name}: there are no tetrahedra; give a mesh with soft tissue")
    if not (finite := np.isfinite(trunk.nodes).all(axis=1)).all():
        node = int(np.argmin(finite))
        raise InputError(f"{name}: node {node} is not finite ({trunk.nodes[node]}); mesh again")
    if trunk.tissue is not None:
        check_tissue(trunk.tissue, len(trunk.tets), name)
    ranges = (
        ("tets", trunk.tets, 0, count),
        ("skin_nodes", trunk.skin_nodes, 0, count),
        ("skin_faces", trunk.skin_faces, 0, len(trunk.skin_nodes)),
        ("bone", trunk.bone, -1, len(trunk.bone_names)),
        ("bone_faces", trunk.bone_faces, 0, count),
    )
    for field, array, least, end in ranges:
        if array.size and not np.issubdtype(array.dtype, np.integer):
            raise InputError(f"{name}: '{field}' must be of whole numbers, not {array.dtype}; mesh again")
        if array.size and (array.min() < least or array.max() >= end):
            raise InputError(
                f"{name}: '{field}' must lie from {least} to {end - 1}, but has {array.min()} to "
                f"{array.max()}; mesh again"
            )
    if len(np.unique(trunk.skin_nodes)) < len(trunk.skin_nodes) or (trunk.bone[trunk.skin_nodes] >= 0).any():
        raise InputError(f"{name}: each skin vertex needs a node of its own that is not on bone; mesh again")
    volume = tet_volumes(trunk.nodes, trunk.tets)
    if not volume.min() > 0.0:
        raise InputError(
            f"{name}: every tetrahedron must have a positive volume, but tetrahedron {np.argmin(volume)} has "
            f"{volume.min():g} mm^3; check the order of its corners, or mesh again"
        )
    if (again := repeated_tet(trunk.tets, count)) is not None:
        raise InputError(
            f"{name}: each tetrahedron must be there once, but tetrahedron {again} has the corners of an "
            "earlier one; remove it, or mesh again"
        )


def repeated_tet(tets: np.ndarray, nodes: int) -> int | None:
    """The first tetrahedron with the corners of an earlier one, in any order; None where each is there once."""
    mark = np.random.default_rng(0).integers(np.iinfo(np.int64).max, size=nodes)
    sums = mark[tets].sum(axis=1)  # wraps; equal where corners are, and else by a chance of 1e-9
    sums.sort()  # a tenth of the time of np.unique
    if np.all(sums[1:] != sums[:-1]):
        return None
    _, first, same = np.unique(np.sort(tets, axis=1), axis=0, return_index=True, return_inverse=True)
    return next(iter(np.flatnonzero(first[same.ravel()] != np.arange(len(tets))).tolist()), None)


def check_tissue(tissue: np.ndarray, tets: int, name: str) -> None:
    """InputError where a mesh's tissue is neither one label nor parts that make a whole for each tetrahedron."""
    labels = tissue.shape == (tets,) and np.issubdtype(tissue.dtype, np.integer)
    parts = tissue.ndim == 2 and len(tissue) == tets and np.issubdtype(tissue.dtype, np.floating)
    if not (labels or parts):
        raise InputError(
            f"{name}: 'tissue' must be one whole number, or the part of each tissue, for each of {tets} "
            f"tetrahedra, not {tissue.dtype} of shape {tissue.shape}; label them again"
        )
    if parts and not (tissue.min() >= -1e-6 and np.abs(tissue.sum(axis=1) - 1.0).max() <= 1e-6):
        raise InputError(
            f"{name}: the parts of 'tissue' in each tetrahedron must be from 0 and add to 1; label again"
        )


def tet_volumes(nodes: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Signed volumes [mm^3] of tetrahedra, 1/6 P_ji . (P_ki x P_li), shape (tets,)."""
    along = np.ascontiguousarray(nodes.T)  # NumPy works several times as fast on long rows
    i, *edge_vectors = (along.take(corner, axis=1) for corner in tets.T)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (other - i for other in edge_vectors)
    return (ax * (by * cz - bz * cy) + az * (bx * cy - by * cx) + ay * (bz * cx - bx * cz)) / 6.0  # bits of einsum


def oriented(nodes: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """The same tetrahedra with two corners swapped where the volume is negative."""
    flip = tet_volumes(nodes, tets) < 0.0
    tets = tets.copy()
    tets[flip, 2], tets[flip, 3] = tets[flip, 3], tets[flip, 2].copy()
    return tets
