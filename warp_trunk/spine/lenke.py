"""The type of a scoliosis by Lenke, from its curves and their flexibility on films of side bending."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from warp_trunk.case.anatomy import LUMBAR, THORACIC

from .cobb import CobbAngle, sagittal_angle
from .spine import SacralLine, Spine

Part = Literal["proximal", "thoracic", "lumbar"]

STRUCTURAL = 25.0
"""A minor curve that keeps this much on a film of side bending is structural [degrees]."""
KYPHOTIC = 20.0
"""So is one whose junction, T2 to T5 or T10 to L2, is as round [degrees]."""
UNBENT = 1.3
"""Without films a minor curve of `STRUCTURAL` is taken as structural where the major one is less than so many
times as large: 1.34 in 1C and 2C (Ishikawa et al., J Orthop Sci 2015, 20:31), 1.22 in 34 double major curves."""
BODY = 0.95
"""Half the width of a lumbar body over the distance between its pedicles' centres."""
_TYPES = {
    ("thoracic", frozenset()): "1",
    ("thoracic", frozenset({"proximal"})): "2",
    ("thoracic", frozenset({"lumbar"})): "3",
    ("thoracic", frozenset({"proximal", "lumbar"})): "4",
    ("lumbar", frozenset()): "5",
    ("lumbar", frozenset({"thoracic"})): "6",
    ("lumbar", frozenset({"proximal"})): "5",
    ("lumbar", frozenset({"proximal", "thoracic"})): "4",
}


def lenke_type(
    spine: Spine, curves: Sequence[CobbAngle], line: SacralLine, flexibility: Mapping[str, float] | None = None
) -> str:
    """Curve type 1 to 6 with the lumbar modifier A, B or C; empty without a thoracic or lumbar curve.

    The major curve is the larger of the main thoracic (apex T6 to T11) and the thoracolumbar or lumbar one (T12 to
    L4). Minor curves are structural by `STRUCTURAL` and `KYPHOTIC`. The modifier says where the central sacral
    vertical line passes the apex of the lumbar curve: between its pedicles, within its body, or beside it (Lenke
    et al., J Bone Joint Surg Am 2001, 83:1169). Without a lumbar curve it is A.

    Args:
        spine: vertebrae [mm].
        curves: those of the spine (`cobb_angles`).
        line: the sacral line.
        flexibility: share of the Cobb angle that bends out, by apex, of curves whose films are there.
    """
    largest: dict[Part, CobbAngle] = {}
    for curve in curves:
        part = _part(curve.apex)
        if part is not None and curve.angle > (largest[part].angle if part in largest else 0.0):
            largest[part] = curve
    majors: list[Part] = [part for part in ("thoracic", "lumbar") if part in largest]
    if not majors:
        return ""
    major = max(majors, key=lambda part: largest[part].angle)
    round_at = {
        "proximal": sagittal_angle(spine, "T2", "T5"),
        "thoracic": sagittal_angle(spine, "T10", "L2"),
        "lumbar": sagittal_angle(spine, "T10", "L2"),
    }
    structural = frozenset(
        part
        for part, curve in largest.items()
        if part != major
        and (_keeps(curve, largest[major].angle, flexibility or {}) or (round_at[part] or 0.0) >= KYPHOTIC)
    )
    return _TYPES[major, structural] + _modifier(spine, largest.get("lumbar"), line)


def _part(apex: str) -> Part | None:
    if apex in THORACIC[1:5]:
        return "proximal"
    if apex in THORACIC[5:11]:
        return "thoracic"
    return "lumbar" if apex in (THORACIC[11], *LUMBAR[:4]) else None


def _keeps(curve: CobbAngle, major: float, flexibility: Mapping[str, float]) -> bool:
    """Whether a minor curve is structural by its size."""
    bent_out = flexibility.get(curve.apex)
    if bent_out is None:
        return curve.angle >= STRUCTURAL and major < UNBENT * curve.angle
    return (1.0 - bent_out) * curve.angle >= STRUCTURAL


def _modifier(spine: Spine, curve: CobbAngle | None, line: SacralLine) -> str:
    if curve is None:
        return "A"
    row = spine.levels.index(curve.apex)
    aside = abs(float((spine.endplates[row].mean(axis=0)[:2] - line.point) @ line.across))
    apart = float(np.linalg.norm(spine.pedicles[row, 0] - spine.pedicles[row, 1]))
    if not aside <= BODY * apart:
        return "C"
    return "A" if aside <= 0.5 * apart else "B"
