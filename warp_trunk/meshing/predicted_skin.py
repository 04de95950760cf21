"""The skin of a case moved with its mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

from warp_trunk.geometry.surface import Surface

if TYPE_CHECKING:
    import numpy as np

    from warp_trunk.case import Case
    from warp_trunk.engine.trunk_mesh import TrunkMesh


def predicted_skin(case: Case, trunk: TrunkMesh, displacement: np.ndarray) -> Surface:
    """The skin of a case, same vertices and faces, moved with the nodes' displacement (nodes, 3) [mm]."""
    return case.skin.moved(case.skin.vertices + displacement[trunk.skin_nodes])
