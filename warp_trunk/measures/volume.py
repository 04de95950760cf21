"""Change of volume: tissue neither grows nor goes away in an operation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.engine.trunk_mesh import tet_volumes

if TYPE_CHECKING:
    from warp_trunk.engine.trunk_mesh import TrunkMesh


def tissue_volume_change(trunk: TrunkMesh, displacement: np.ndarray) -> float:
    """How much the soft tissue as a whole has grown [%], negative where it shrank.

    Soft tissue is nearly incompressible, so a simulation that changes its volume by percents is not to be
    trusted there. An inverted tetrahedron counts as negative.

    Args:
        trunk: the mesh between bones and skin.
        displacement: of its nodes [mm], shape (nodes, 3).
    """
    before = tet_volumes(trunk.nodes, trunk.tets).sum()
    after = tet_volumes(trunk.nodes + displacement, trunk.tets).sum()
    return 100.0 * (float(after / before) - 1.0)
