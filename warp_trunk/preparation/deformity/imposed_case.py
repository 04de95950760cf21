"""A case made from straight, healthy anatomy: a scoliosis and its correction, both known exactly."""

from __future__ import annotations

from collections.abc import Mapping

from warp_trunk.case import Case
from warp_trunk.geometry.surface import Surface

from ..landmark_finder import find_landmarks
from .deformity import correct, impose
from .spine_curve import SpineCurve


def make_case(
    skin: Surface,
    bones: Mapping[str, Surface],
    curve: SpineCurve,
    correction: float,
    name: str | None = None,
) -> Case:
    """Impose a curve on straight anatomy and plan the correction of a fraction of it.

    There is no trunk after surgery to compare with.

    Args:
        skin: the straight trunk, closed, in patient axes (LPS) [mm].
        bones: T1 to L5, hip_left and hip_right, and as many others as there are, by name.
        curve: the deformity before surgery.
        correction: fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1.
        name: what to call the case; made from the curve when left out.

    Raises:
        InputError: bones without landmarks to find (`find_landmarks`), a curve that folds the trunk
            (`impose`), or a fraction outside [0, 1].
    """
    straight = find_landmarks(bones).complete()
    after = correct(straight, curve, correction)
    deformed, moved, before = impose(skin, bones, straight, curve)
    return Case(
        name=name or f"{curve.kind} {curve.cobb:g} degrees, {100 * correction:g} % corrected",
        skin=deformed,
        bones=moved,
        landmarks_before=before,
        landmarks_after=after,
    )
