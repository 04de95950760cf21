"""Whether a mesh, its tissues and the options can make a model, before anything is uploaded."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

import numpy as np

from warp_trunk.errors import InputError

from .energies.by_name import EnergyName, WeightsName
from .rest_mesh import PRECISIONS
from .tissue import Tissue
from .topology import find_pieces
from .trunk_mesh import TrunkMesh


def check_arguments(
    energy: str, weights: str, precision: str, skin_rigidity: float, gravity: float, alpha: float | None = None
) -> None:
    """InputError where an argument of `build_model` that no mesh is needed for is out of its range."""
    _check_choice("precision", precision, PRECISIONS)
    _check_choice("energy", energy, get_args(EnergyName))
    _check_choice("weights", weights, get_args(WeightsName))
    if not (np.isfinite(skin_rigidity) and skin_rigidity >= 0.0):
        raise InputError(f"skin_rigidity: must be a finite number of N mm, 0 or more, not {skin_rigidity}")
    if not np.isfinite(gravity):
        raise InputError(f"gravity: must be a finite acceleration in m/s^2, not {gravity}")
    if alpha is not None:
        if not (np.isfinite(alpha) and alpha >= 0.0):
            raise InputError(f"alpha: must be a finite number, 0 or more, not {alpha}")
        if energy != "itmsm":
            raise InputError(f"alpha: is a constant of itmsm (eq. 4.6), not of {energy}; give gravity")
        if gravity:
            raise InputError(f"alpha: is gravity against stiffness; leave it or gravity = {gravity:g} m/s^2 out")


def _check_choice(name: str, value: str, choices: Iterable[str]) -> None:
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
