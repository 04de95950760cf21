"""The synthetic patient, made once in a process: whole, and with a coarser skin where a smaller mesh serves."""

from dataclasses import replace
from functools import cache
from typing import Any

from warp_trunk.case import Case
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.meshing import MeshOptions
from warp_trunk.preparation.phantom import phantom_case


@cache
def whole_phantom() -> Case:
    """`phantom_case()`."""
    return phantom_case()


@cache
def coarse_phantom() -> Case:
    """It, with edges of 18 mm on its skin."""
    case = whole_phantom()
    return replace(case, skin=coarsen(case.skin, 18.0, 4.0))


def coarse_mesh(**options: Any) -> MeshOptions:
    """How the coarse phantom is meshed: some 27,000 tetrahedra."""
    return MeshOptions(tets=26_000, bone_voxel=8.0, bone_tolerance=2.0, **options)
