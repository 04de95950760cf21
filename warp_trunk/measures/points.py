"""How far the points of a case move, and how far soft tissue follows bone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.points import SKIN
from warp_trunk.geometry.nearest import nearest
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import Surface

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.trunk_mesh import TrunkMesh

Place = tuple[float, float, float]


@dataclass(frozen=True)
class FollowedPoint:
    """A point before surgery and as predicted, in LPS."""

    name: str
    """What it is called."""
    on: str
    """On what it lies, `skin` or a bone."""
    before: Place
    """Before surgery [mm]."""
    after: Place
    """As predicted [mm]."""
    bone_point: str = ""
    """The point on bone with which it is compared; empty for none."""
    ratio: float | None = None
    """How far it moves along the way of that point, as a part of that way: s.h / h.h; None for no way."""

    @property
    def way(self) -> np.ndarray:
        """From before to after [mm], shape (3,)."""
        return np.subtract(self.after, self.before)


def follow_points(case: Case, trunk: TrunkMesh, displacement: np.ndarray) -> tuple[FollowedPoint, ...]:
    """Where the points of a case are carried: on the skin with its triangle, on bone rigidly with that.

    Args:
        case: with its points.
        trunk: its mesh.
        displacement: of its nodes [mm], shape (nodes, 3).
    """
    marks = case.points.marks
    moved: dict[str, tuple[str, np.ndarray, np.ndarray]] = {}
    for name, point, (owner, _) in zip(
        marks.names, marks.points, case.points.owners(case.skin, case.bones), strict=True
    ):
        if owner == SKIN:
            skin = Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces)
            face, weights = nearest(skin, point[None], 1000.0)
            way = weights[0] @ displacement[trunk.skin_nodes[trunk.skin_faces[face[0]]]]
        else:
            held = trunk.bone == trunk.bone_names.index(owner)
            way = fit_rigid(trunk.nodes[held], trunk.nodes[held] + displacement[held]).apply(point) - point
        moved[name] = owner, point, way
    found = []
    for name, (owner, point, way) in moved.items():
        other = case.points.pairs.get(name, "")
        hard = moved[other][2] if other else np.zeros(3)
        ratio = float(way @ hard / (hard @ hard)) if np.linalg.norm(hard) > 1e-3 else None
        found.append(FollowedPoint(name, owner, _place(point), _place(point + way), other, ratio))
    return tuple(found)


def _place(point: np.ndarray) -> Place:
    x, y, z = point.tolist()
    return x, y, z
