"""A vertebra's motion in parts, and which part of its turn goes with its curve."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.known_spine import before_and_after, with_errors
from warp_trunk.bone_motion.vertebra_motion import CoupledTurns, VertebraParts, axial_turn, split
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.rigid import RigidMotion, fit_rigid
from warp_trunk.preparation.deformity import SpineCurve, correct
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.spine.cobb import cobb_angles
from warp_trunk.spine.endplate_smoothing import endplate_smoothing

CENTRE = np.array([12.0, -30.0, 1200.0])
AXIS = np.array([0.0, -0.4, 1.0])


def about(rotation: Rotation, way: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> RigidMotion:
    """A rotation about the centre, then a way."""
    return RigidMotion.about(rotation.as_matrix(), CENTRE, CENTRE + np.array(way))


def parts(motion: RigidMotion, axis: np.ndarray) -> VertebraParts:
    return split(motion, np.array([CENTRE, axis]))


@pytest.mark.parametrize(
    ("about_axis", "axis", "degrees"),
    [
        (AXIS / np.linalg.norm(AXIS), 30.0 * AXIS, (0.0, 0.0, 12.0)),
        ([0.0, 1.0, 0.0], np.array([0.0, 0.0, 1.0]), (12.0, 0.0, 0.0)),
        ([1.0, 0.0, 0.0], AXIS, (0.0, 12.0, 0.0)),
    ],
    ids=["turn about the own axis", "tilt to the left", "flexion to the front"],
)
def test_a_rotation_about_one_axis_is_one_part(about_axis, axis: np.ndarray, degrees: tuple[float, ...]) -> None:
    split = parts(about(Rotation.from_rotvec(np.radians(12.0) * np.array(about_axis)), (5.0, 0.0, 2.0)), axis)
    assert np.degrees([split.lateral_bending, split.flexion, split.axial_rotation]) == pytest.approx(
        degrees, abs=1e-9
    )
    assert split.shift == pytest.approx(5.0, abs=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_what_a_curve_turned_its_correction_turns_back_about_the_same_axis(tilt: float) -> None:
    straight, curved, corrected = (
        Rotation.from_euler("YXZ", angles, degrees=True) for angles in ((0, 20, 0), (-18, 24, 13), (-5, 21, 4))
    )

    def shared(before: Rotation, after: Rotation) -> np.ndarray:
        split = parts(about(after * before.inv()), before.apply([0.0, 0.0, 1.0]))
        return split.share(axial_rotation=0.6 * split.axial_rotation, lateral_bending=tilt)

    grown, back = shared(straight, curved), shared(curved, straight)
    np.testing.assert_allclose(back @ grown, np.eye(3), atol=1e-12)
    by_way = shared(curved, corrected) @ grown
    np.testing.assert_allclose(by_way, shared(straight, corrected), atol=1e-12)


@pytest.mark.parametrize("degrees", [-17.0, 4.0])
def test_a_motion_less_all_of_its_turn_only_leans(degrees: float) -> None:
    rotation = Rotation.from_euler("YXZ", [15.0, 6.0, degrees], degrees=True)
    split = parts(about(rotation, (3.0, -2.0, 8.0)), np.array([0.0, 0.0, 1.0]))
    around = CENTRE + 30.0 * np.vstack([np.zeros(3), np.eye(3)])
    left = fit_rigid(around, split.without(split.axial_rotation, around))
    assert Rotation.from_matrix(left.rotation).as_euler("YXZ", degrees=True) == pytest.approx(
        [15.0, 6.0, 0.0], abs=1e-9
    )
    np.testing.assert_allclose(left.apply(CENTRE), split.motion.apply(CENTRE), atol=1e-9)
    np.testing.assert_allclose(split.without(np.zeros(()), around[1]), split.motion.apply(around[1]), atol=1e-12)


def test_the_turn_of_a_leaning_vertebra_is_found_whichever_way_it_leans() -> None:
    for lean in ((0.0, 0.0), (25.0, 0.0), (-20.0, 15.0)):
        attitude = Rotation.from_euler("YXZ", [*lean, 11.0], degrees=True)
        axis, to_left = attitude.apply([[0.0, 0.0, 30.0], [40.0, 0.0, 0.0]])
        assert np.degrees(axial_turn(axis, to_left, np.array([1.0, 0.0]))) == pytest.approx(11.0, abs=1e-9)
        assert np.degrees(axial_turn(axis, to_left, np.array([0.0, 2.0]))) == pytest.approx(-79.0, abs=1e-9)


_, _, STRAIGHT = straight_trunk()
THORACIC = ("T5", "T7", "T8", "T9", "T11")


def spine(curve: SpineCurve) -> Landmarks:
    return correct(STRAIGHT, curve, 0.0)


def rotations(curve: SpineCurve) -> dict[str, float]:
    """The turn of each vertebra by the curve itself [degrees]."""
    return {name: float(np.degrees(pose.rotation)) for name, pose in vertebra_poses(STRAIGHT, curve).items()}


def coupled_turns(before: Landmarks, after: Landmarks, *, broken: bool = False) -> dict[str, float]:
    """Those of each vertebra [degrees]; the steps of a broken spine are no errors."""
    levels = before.vertebrae()
    coupled = CoupledTurns(before, levels)
    plates = [coupled.endplates(marks.points) for marks in (before, after)]
    smoothing = [None if broken else endplate_smoothing(endplates) for endplates in plates]
    turns = coupled.of(cobb_angles(before), before.points[None], after.points[None], smoothing)
    return dict(zip(levels, np.degrees(turns[0]).tolist(), strict=True))


def coupled(before: SpineCurve, after: SpineCurve) -> dict[str, float]:
    return coupled_turns(spine(before), spine(after))


@pytest.mark.parametrize("direction", ["right", "left"])
@pytest.mark.parametrize("fraction", [0.3, 0.7, 1.0])
def test_where_rotation_is_corrected_as_the_curve_is_all_of_the_turn_goes_with_it(direction, fraction) -> None:
    curve = SpineCurve(cobb=50.0, direction=direction)
    turns, whole = coupled(curve, curve.corrected(fraction)), rotations(curve)
    assert abs(whole["T8"]) == pytest.approx(17.8, abs=1.0)
    for level in THORACIC:
        assert turns[level] == pytest.approx(-fraction * whole[level], abs=0.3)


def test_derotation_at_the_same_curve_changes_nothing_of_it() -> None:
    curve = SpineCurve(cobb=50.0)
    left = curve.corrected(0.6)
    more = replace(left, apical_rotation=left.rotation - 4.0)
    less, other = coupled(curve, left), coupled(curve, more)
    for level in THORACIC:
        assert other[level] == pytest.approx(less[level], abs=0.05)


def test_curves_of_one_spine_have_their_own_parts() -> None:
    curve = SpineCurve(kind="double_major", cobb=50.0)
    before, after = spine(curve), spine(curve.corrected(0.5))
    thoracic = {f"T{number}" for number in range(1, 11)}
    mixed = Landmarks(
        before.names,
        np.where([[name.split("_")[0] in thoracic] for name in before.names], after.points, before.points),
    )
    turns = coupled_turns(before, mixed, broken=True)
    assert {"T8", "L2"} <= {cobb.apex for cobb in cobb_angles(before)}
    assert abs(turns["T8"]) > 2.0
    assert abs(turns["L2"]) < 1.5


def test_errors_of_landmarks_do_not_change_the_mean_turns() -> None:
    """Landmarks off by 2.1 +- 1.5 mm: the mean of 60 draws is the turn without errors, within 0.3 deviations."""
    before, after = before_and_after()
    exact, drawn = coupled_turns(before, after), []
    for seed in range(60):
        random = np.random.default_rng(seed)
        drawn.append(coupled_turns(with_errors(before, random), with_errors(after, random)))
    for level in ("T6", "T8", "T10"):
        turns = np.array([draw[level] for draw in drawn])
        assert abs(turns.mean() - exact[level]) < 0.3 * turns.std()
