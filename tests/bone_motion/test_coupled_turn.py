"""Which part of a vertebra's turn goes with its curve, on spines whose curve and rotation are known."""

from dataclasses import replace

import numpy as np
import pytest

from warp_trunk.bone_motion.vertebra_motion import CoupledTurns
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.measures.cobb import cobb_angles
from warp_trunk.preparation.deformity import SpineCurve, correct
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses
from warp_trunk.preparation.phantom import straight_trunk

_, _, STRAIGHT = straight_trunk()
LEVELS = ("T5", "T7", "T8", "T9", "T11")


def spine(curve: SpineCurve) -> Landmarks:
    return correct(STRAIGHT, curve, 0.0)


def rotations(curve: SpineCurve) -> dict[str, float]:
    """The turn of each vertebra by the curve itself [degrees]."""
    return {name: float(np.degrees(pose.rotation)) for name, pose in vertebra_poses(STRAIGHT, curve).items()}


def coupled_turns(before: Landmarks, after: Landmarks) -> dict[str, float]:
    """Those of each vertebra [degrees]."""
    levels = before.vertebrae()
    turns = CoupledTurns(before, levels).of(cobb_angles(before), before.points[None], after.points[None])
    return dict(zip(levels, np.degrees(turns[0]).tolist(), strict=True))


def coupled(before: SpineCurve, after: SpineCurve) -> dict[str, float]:
    return coupled_turns(spine(before), spine(after))


@pytest.mark.parametrize("direction", ["right", "left"])
@pytest.mark.parametrize("fraction", [0.3, 0.7, 1.0])
def test_where_rotation_is_corrected_as_the_curve_is_all_of_the_turn_goes_with_it(direction, fraction) -> None:
    curve = SpineCurve(cobb=50.0, direction=direction)
    found, whole = coupled(curve, curve.corrected(fraction)), rotations(curve)
    assert abs(whole["T8"]) == pytest.approx(17.8, abs=1.0)
    for level in LEVELS:
        assert found[level] == pytest.approx(-fraction * whole[level], abs=0.3)


def test_derotation_at_the_same_curve_changes_nothing_of_it() -> None:
    curve = SpineCurve(cobb=50.0)
    left = curve.corrected(0.6)
    more = replace(left, apical_rotation=left.rotation - 4.0)
    one, other = coupled(curve, left), coupled(curve, more)
    for level in LEVELS:
        assert other[level] == pytest.approx(one[level], abs=0.05)


def test_curves_of_one_spine_have_their_own_parts() -> None:
    curve = SpineCurve(kind="double_major", cobb=50.0)
    before, after = spine(curve), spine(curve.corrected(0.5))
    thoracic = {f"T{number}" for number in range(1, 11)}
    mixed = Landmarks(
        before.names,
        np.where([[name.split("_")[0] in thoracic] for name in before.names], after.points, before.points),
    )
    found = coupled_turns(before, mixed)
    assert {"T8", "L2"} <= {one.apex for one in cobb_angles(before)}
    assert abs(found["T8"]) > 2.0
    assert abs(found["L2"]) < 1.5
