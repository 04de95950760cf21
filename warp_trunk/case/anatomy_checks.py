"""Doubts of the anatomy of a case: bones that are missing or out of order, landmarks off their bone's feature."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import area_centre

from .anatomy import HIPS, PELVIC_RING, SIDES, THORACIC
from .case import Case
from .landmarks import ASIS, VERTEBRA_POINTS

_BEHIND = 12.0
"""An anterior superior iliac spine lies behind the frontmost point of its hip bone's upper half by less [mm]."""
_OFF_FEATURE, _OFF_BY_ERROR = 6.5, 3.5
"""A landmark lies on its vertebra as the mean of those above and below, within this [mm] and so many standard
deviations of the errors of landmarks."""
_AT_END = 1.5
"""At an end of the spine, where there is no mean, within this many times as much."""
_FEWEST_VERTEBRAE = 3
"""Vertebrae with landmarks and bones that are needed to compare each with its neighbours."""
_OUT = 1.5
"""A bone reaches out of the skin by less [mm]."""
_UNLIKE = 6.0
"""The skin covers the crests of both hip bones by as much, within this [mm]: 5 at most in eleven trunks."""
_MUCH_LESS = 0.45
"""... or the one by more than this part of the other: curves that were imposed moved thick fat by 10 mm."""
_CREST = 10.0
"""Vertices of a hip bone that are nearer than this to its outermost one, to its side, are its crest [mm]."""
_THIN = 10.0
"""A skin covers the hip bones behind by less [mm]: then it covers them in front by hardly more, as fat lies on
both; of more fat there is often more on one side."""
_HEADS = 30
"""Vertices of a rib that are nearest to the spine: its head."""
_ROUGH = 3.0
"""The heads of two ribs may be in the wrong order by this [mm]."""


def anatomy_doubts(case: Case) -> list[str]:
    """A sentence for each doubt, with the number found and the cure; none for a part of the body without a spine.

    Args:
        case: checked as far as its files go, in LPS and mm.
    """
    if not case.has_spine:
        return []
    has_chest = sum(name in case.bones for name in THORACIC) >= _FEWEST_VERTEBRAE
    doubts = [
        *(_missing(case) if has_chest else ()),
        *_rib_order(case),
        *_iliac_spines(case),
        *_off_features(case),
        *_outside(case),
        *_aside(case),
    ]
    return [f"Anatomy: {doubt}." for doubt in doubts]


def _missing(case: Case) -> list[str]:
    bones, doubts = case.bones, []
    ribs = {side: [n for n in range(1, 13) if f"rib_{side}_{n:02d}" in bones] for side in SIDES}
    if not any(ribs.values()):
        doubts.append(
            "there is no rib, so that soft tissue fills the chest and the hump is wrong (21 for 13 mm in one "
            "trunk); add bones/rib_left_01 to rib_right_12"
        )
    for side, other in (SIDES, SIDES[::-1]):
        if lost := [n for n in ribs[other] if n not in ribs[side]]:
            names = ", ".join(map(str, lost))
            doubts.append(
                f"{len(lost)} of the {len(ribs[other])} ribs of the {other} side have none opposite: the {side} "
                f"side lacks {names}, and the back moves there without bone (hump up to 18 mm off); add them"
            )
    if any(ribs.values()) and "sternum" not in bones:
        doubts.append("there is no sternum, so that the ribs' front ends are free; add bones/sternum")
    if lost := [name for name in PELVIC_RING if name not in bones]:
        doubts.append(
            f"of the pelvis {', '.join(lost)} {'is' if len(lost) == 1 else 'are'} missing, and nothing holds the "
            "trunk there (skin moves 21 for 13 mm without all three); add them"
        )
    return doubts


def _rib_order(case: Case) -> list[str]:
    """Ribs whose heads are in another order along the spine than their numbers."""
    spine = np.array([case.bones[name].vertices.mean(axis=0) for name in THORACIC if name in case.bones])
    doubts = []
    for side in SIDES:
        heads = {}
        for number in range(1, 13):
            bone = case.bones.get(f"rib_{side}_{number:02d}")
            if bone is not None and f"T{number}" in case.bones:
                away = np.linalg.norm(bone.vertices[:, None] - spine, axis=2).min(axis=1)
                heads[number] = float(np.median(bone.vertices[np.argsort(away)[:_HEADS], 2]))
        numbers = list(heads)
        for upper, lower in pairwise(numbers):
            if heads[lower] > heads[upper] + _ROUGH:
                doubts.append(
                    f"rib_{side}_{lower:02d} begins {heads[lower] - heads[upper]:.0f} mm above "
                    f"rib_{side}_{upper:02d}; exchange their names where they are exchanged"
                )
    return doubts


def _iliac_spines(case: Case) -> list[str]:
    """Iliac spines that are not the frontmost point of their hip bone."""
    doubts = []
    for name, hip in ASIS.items():
        if hip not in case.bones:
            continue
        vertices = case.bones[hip].vertices
        upper = vertices[vertices[:, 2] > vertices[:, 2].mean()]
        behind = float(case.landmarks_before.point(name)[1] - upper[:, 1].min())
        if behind > _BEHIND:
            doubts.append(
                f"'{name}' lies {behind:.0f} mm behind the frontmost point of {hip}, and {_BEHIND:g} is the most; "
                "rotations are measured against it, so mark it again"
            )
    return doubts


def _off_features(case: Case) -> list[str]:
    """Landmarks that lie elsewhere on their vertebra than those of its neighbours."""
    marks = case.landmarks_before
    levels = [name for name in marks.vertebrae() if name in case.bones]
    if len(levels) < _FEWEST_VERTEBRAE:
        return []
    six = np.array([[marks.point(f"{level}_{name}") for name in VERTEBRA_POINTS] for level in levels])
    places = six - np.array([area_centre(case.bones[n]) for n in levels])[:, None]
    allowed, doubts = _OFF_FEATURE + _OFF_BY_ERROR * case.uncertainty.landmark_sd, []
    for row, level in enumerate(levels):
        pairs = [(row - n, row + n) for n in (1, 2) if row - n >= 0 and row + n < len(levels)]
        expected = [0.5 * (places[first] + places[other]) for first, other in pairs]
        near = places[max(row - 2, 0) : row + 3]  # at an end of the spine
        off = places[row] - (np.mean(expected, axis=0) if pairs else np.median(near, axis=0))
        away = np.linalg.norm(off, axis=1)
        worst, most = int(away.argmax()), allowed * (1.0 if pairs else _AT_END)
        if away[worst] > most:
            together = np.linalg.norm(off.mean(axis=0)) >= 0.7 * away[worst]
            what = (
                f"the landmarks of {level} together lie up to"
                if together
                else (f"'{level}_{VERTEBRA_POINTS[worst]}' lies")
            )
            place = "from the place on the bone where those of the neighbours lie"
            doubts.append(f"{what} {away[worst]:.0f} mm {place}, and {most:.0f} mm is the most; mark them again")
    return doubts


def _aside(case: Case) -> list[str]:
    """A skin that lies further over one hip bone than over the other, or further in front of them than behind."""
    if not all(name in case.bones for name in HIPS):
        return []
    left, right = (case.bones[name].vertices for name in HIPS)
    both = np.vstack([hip[hip[:, 2] > hip[:, 2].mean()] for hip in (left, right)])  # above the pubis
    crests = [
        left[left[:, 0] > left[:, 0].max() - _CREST],
        right[right[:, 0] < right[:, 0].min() + _CREST],
        both[both[:, 1] < both[:, 1].min() + _CREST],
        both[both[:, 1] > both[:, 1].max() - _CREST],
    ]
    left, right, front, back = (-float(far) for _, far in SurfaceDistance(case.skin).outermost(crests))
    if min(left, right, back) < -_OUT:  # bone that reaches out is said by itself
        return []
    doubt = ""
    if abs(left - right) > _UNLIKE and min(left, right) < _MUCH_LESS * max(left, right):
        doubt = f"hip_left by {left:.0f} mm and hip_right by {right:.0f} mm"
    elif back < _THIN and front - back > _UNLIKE:
        doubt = f"the hip bones by {front:.0f} mm in front and by {max(back, 0.0):.0f} mm behind"
    most = f"and {_UNLIKE:g} mm is the most between both where skin is thin; bring skin and bones into one frame"
    return [f"the skin covers {doubt}, {most}"] if doubt else []


def _outside(case: Case) -> list[str]:
    """The bone that reaches furthest out of the skin."""
    names = list(case.bones)
    outermost = SurfaceDistance(case.skin).outermost([case.bones[name].vertices for name in names])
    out = np.array([far for _, far in outermost])
    if not out.size or out.max() <= _OUT:
        return []
    name = names[int(out.argmax())]
    other_bones = int((out > _OUT).sum()) - 1
    what = f"{name} and {other_bones} more reach" if other_bones else f"{name} reaches"
    return [f"{what} out of the skin, by up to {out.max():.1f} mm; bring skin and bones into one frame"]
