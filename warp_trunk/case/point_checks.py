"""Checks of the points that are followed against the skin and the bones of a case."""

from warp_trunk.errors import InputError

from .case import Case
from .points import SKIN

_FAR = 5.0
"""Largest distance of a point from its surface [mm]."""


def check_points(case: Case, where: str) -> None:
    """Check that points lie on the skin or a bone, and that each pair is a point on the skin and one on bone.

    Raises:
        InputError: the first point or pair that violates this.
    """
    names, pairs = case.points.marks.names, case.points.pairs
    owners = dict(zip(names, case.point_owners, strict=True))
    for name, (owner, off) in owners.items():
        if off > _FAR:
            far = f"'{name}' is {off:.1f} mm from {owner}, the nearest surface, {_FAR:g} mm is allowed"
            raise InputError(f"{where}: {far}; place it on the skin or on a bone")
    for name, other in pairs.items():
        if other not in owners:
            raise InputError(f"{where}: '{name}' names '{other}', which is not among the points; add or rename it")
        soft, hard = owners[name][0], owners[other][0]
        if soft != SKIN or hard == SKIN:
            places = f"'{name}' lies on {soft} and '{other}' on {hard}"
            raise InputError(f"{where}: {places}; compare a point on the skin with one on a bone")
