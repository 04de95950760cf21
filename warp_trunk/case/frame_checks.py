"""Whether what is known after surgery is in the frame of what is known before: the pelvis does not move."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import Surface

from .landmarks import ASIS, Landmarks

if TYPE_CHECKING:
    from .case import Case

MOVED_REFUSED, MOVED_WARNED = 10.0, 5.0
"""How far the iliac spines may move [mm]; two reconstructions with the papers' errors of 2.1 +- 1.5 mm move one of
them by more than 10 mm in one case of 300."""
PELVIS = (*ASIS.values(), "sacrum")
"""Bones whose landmarks hold the pelvis."""


def check_frame(before: Landmarks, after: Landmarks, where: str) -> list[str]:
    """Check that the pelvis, which surgery leaves where it is, does not move from before to after.

    Args:
        before: with both iliac spines [mm].
        after: those after, by the same names.
        where: the file of those after, for the error.

    Returns:
        A sentence where an iliac spine moves by more than `MOVED_WARNED`.

    Raises:
        InputError: one moves by more than `MOVED_REFUSED`, or their distance changes by as much.
    """
    spines = [np.array([marks.point(name) for name in ASIS]) for marks in (before, after)]
    apart = [float(np.linalg.norm(one - other)) for one, other in spines]
    if abs(apart[1] - apart[0]) > MOVED_REFUSED:
        raise InputError(
            f"{where}: 'asis_left' and 'asis_right' are {apart[1]:.0f} mm apart, but {apart[0]:.0f} mm before "
            f"surgery, and {MOVED_REFUSED:g} mm is the most that errors explain; mark them again, or give "
            "landmarks of one patient in one unit"
        )
    moved = np.linalg.norm(spines[1] - spines[0], axis=1)
    worst = int(moved.argmax())
    if moved[worst] <= MOVED_WARNED:
        return []
    text = (
        f"{where}: '{list(ASIS)[worst]}' moves by {moved[worst]:.1f} mm, though surgery leaves the pelvis in place"
    )
    if moved[worst] <= MOVED_REFUSED:
        return [
            f"{text}; if the landmarks after surgery are in a frame of their own, --align-pelvis brings them back."
        ]
    raise InputError(
        f"{text} ({MOVED_REFUSED:g} mm is the most that errors explain); give both files in one frame, or bring "
        "what is known after surgery back onto the pelvis with --align-pelvis"
    )


def align_pelvis(case: Case) -> Case:
    """The case with all that is known after surgery moved rigidly, so that the pelvis is where it was before.

    The motion is the one nearest to that of all landmarks of the pelvis. Two iliac spines alone leave the turn
    about the line through them open: it is then taken as none.
    """
    names = case.landmarks_before.names
    held = [i for i, name in enumerate(names) if name in ASIS or name.startswith(tuple(f"{b}_" for b in PELVIS))]
    if not held:
        raise InputError("--align-pelvis: needs landmarks of the pelvis, before and after surgery; leave it out")
    after = case.planned_landmarks
    back = fit_rigid(after.points[held], case.landmarks_before.points[held])

    def moved(surface: Surface) -> Surface:
        return Surface(back.apply(surface.vertices), surface.faces)

    return replace(
        case,
        landmarks_after=Landmarks(names, back.apply(after.points)),
        actual_skin=None if case.actual_skin is None else moved(case.actual_skin),
        bones_after={name: moved(bone) for name, bone in case.bones_after.items()},
    )
