"""How far the points of a case move, and how far soft tissue follows bone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.points import SKIN
from warp_trunk.geometry.distance_field import nearest

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.geometry.rigid import RigidMotion

Place = tuple[float, float, float]


@dataclass(frozen=True)
class FollowedPoint:
    """A point before surgery and as predicted, in LPS."""

    name: str
    """Its name."""
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


def follow_points(
    case: Case, skin: np.ndarray, motion_of: Callable[[str], RigidMotion]
) -> tuple[FollowedPoint, ...]:
    """Displaced points of a case: on the skin with their triangle, on bone rigidly.

    Args:
        case: the case with its points.
        skin: vertices of the predicted skin [mm], shape (vertices, 3).
        motion_of: the motion of a bone by its name.
    """
    marks = case.points.marks
    moved: dict[str, tuple[str, np.ndarray, np.ndarray]] = {}
    for name, point, (owner, _) in zip(marks.names, marks.points, case.point_owners, strict=True):
        if owner == SKIN:
            face, weights = nearest(case.skin, point[None], 1000.0)
            corners = case.skin.faces[face[0]]
            way = weights[0] @ (skin[corners] - case.skin.vertices[corners])
        else:
            way = motion_of(owner).apply(point) - point
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


ANGLES = {
    "Nasolabial angle [°]": ("columella", "subnasale", "upper_lip"),
    "Mentolabial angle [°]": ("lower_lip", "mentolabial_fold", "chin"),
}
"""Each with its first point, its corner and its last point (Legan and Burstone 1980)."""
LINE = ("nose_tip", "chin")
"""The ends of the E-line (Ricketts 1957)."""


def profile(places: Mapping[str, np.ndarray]) -> dict[str, float]:
    """The measures whose points are there: angles, and how far lips are in front of the E-line, from the side.

    Args:
        places: points by name, in LPS [mm], shape (3,) each.
    """
    found = {}
    for name, corners in ANGLES.items():
        if places.keys() >= set(corners):
            first, corner, last = (places[point] for point in corners)
            one, other = first - corner, last - corner
            found[name] = math.degrees(math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other)))
    if places.keys() >= set(LINE):
        (_, back, up), tip = places[LINE[1]] - places[LINE[0]], places[LINE[0]]
        for lip in {"upper_lip", "lower_lip"} & places.keys():
            _, behind, above = places[lip] - tip
            found[f"{lip} in front of the E-line [mm]"] = float(behind * up - above * back) / math.hypot(back, up)
    return dict(sorted(found.items()))
