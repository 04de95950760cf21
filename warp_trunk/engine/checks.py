"""Whether a mesh and its tissues can make a model, before anything is uploaded."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError

from .tissue import Tissue
from .topology import find_pieces
from .trunk_mesh import TrunkMesh


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


def check_held(trunk: TrunkMesh) -> None:
    """InputError where no bone holds a piece of free tissue."""
    if loose := unheld_nodes(trunk):
        raise InputError(
            f"trunk: {loose} free nodes belong to tissue that no bone holds, so it could move rigidly; "
            "remove that piece or mark nodes of it as bone"
        )


def unheld_nodes(trunk: TrunkMesh) -> int:
    """Number of free nodes in connected pieces of tissue whose prescribed nodes leave a rigid motion free."""
    label = find_pieces(trunk.tets, len(trunk.nodes))
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
