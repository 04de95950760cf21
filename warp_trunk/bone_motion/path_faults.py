"""Where the path of the bones cannot be followed by tissue: bones that collide, and folds of what lies between."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.engine.trunk_mesh import tet_volumes

if TYPE_CHECKING:
    from warp_trunk.engine.trunk_mesh import TrunkMesh

    from .bone_path import BonePath


def colliding_bones(trunk: TrunkMesh, bone_path: BonePath) -> list[str]:
    """Where tetrahedra whose corners all lie on bone end inside out, in words; whatever the tissue does.

    Between two bones they are inside out because the bones have passed through each other, on one bone because
    the path folds it.
    """
    return _places(trunk, _inverted(trunk, bone_path) & trunk.prescribed[trunk.tets].all(axis=1), "bones collide")


def folded_tissue(trunk: TrunkMesh, bone_path: BonePath) -> list[str]:
    """Where the path, which carries all nodes, turns tetrahedra inside out, in words; relaxation may mend them."""
    return _places(trunk, _inverted(trunk, bone_path), "the path of the bones folds tissue")


def _inverted(trunk: TrunkMesh, bone_path: BonePath) -> np.ndarray:
    """Tetrahedra that the path turns inside out at its end, shape (tets,)."""
    return tet_volumes(trunk.nodes + bone_path.at(1.0), trunk.tets) <= 0.0


def _places(trunk: TrunkMesh, inverted: np.ndarray, what: str) -> list[str]:
    """Such tetrahedra by the bones they touch, most first, in words."""
    found: dict[tuple[str, ...], list[int]] = {}
    for tet in np.flatnonzero(inverted):
        bones = sorted({trunk.bone_names[b] for b in trunk.bone[trunk.tets[tet]] if b >= 0})
        found.setdefault(tuple(bones), []).append(int(tet))
    sentences = []
    for bones, tets in sorted(found.items(), key=lambda item: -len(item[1])):
        middle = trunk.nodes[trunk.tets[tets]].mean(axis=(0, 1))
        near = f"at {' and '.join(bones)}, " if bones else ""
        place = "({:.0f}, {:.0f}, {:.0f}) mm".format(*middle)
        sentences.append(f"{what} {near}around {place} ({len(tets)} of the tetrahedra)")
    return sentences
