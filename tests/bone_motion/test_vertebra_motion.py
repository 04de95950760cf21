import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warp_trunk.bone_motion.vertebra_motion import VertebraParts, axial_turn, split
from warp_trunk.geometry.rigid import RigidMotion, fit_rigid

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
    found = parts(about(Rotation.from_rotvec(np.radians(12.0) * np.array(about_axis)), (5.0, 0.0, 2.0)), axis)
    assert np.degrees([found.lateral_bending, found.flexion, found.axial_rotation]) == pytest.approx(
        degrees, abs=1e-9
    )
    assert found.shift == pytest.approx(5.0, abs=1e-9)


def test_all_shares_give_the_whole_rotation_back() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        rotation = Rotation.from_rotvec(rng.normal(scale=0.3, size=3))
        found = parts(about(rotation), rng.normal(scale=0.3, size=3) + np.array([0.0, 0.0, 1.0]))
        whole = found.share(axial_rotation=found.axial_rotation, lateral_bending=1.0)
        np.testing.assert_allclose(whole, rotation.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_what_a_curve_turned_its_correction_turns_back_about_the_same_axis(tilt: float) -> None:
    straight, curved, corrected = (
        Rotation.from_euler("YXZ", angles, degrees=True) for angles in ((0, 20, 0), (-18, 24, 13), (-5, 21, 4))
    )

    def shared(before: Rotation, after: Rotation) -> np.ndarray:
        found = parts(about(after * before.inv()), before.apply([0.0, 0.0, 1.0]))
        return found.share(axial_rotation=0.6 * found.axial_rotation, lateral_bending=tilt)

    grown, back = shared(straight, curved), shared(curved, straight)
    np.testing.assert_allclose(back @ grown, np.eye(3), atol=1e-12)
    by_way = shared(curved, corrected) @ grown
    np.testing.assert_allclose(by_way, shared(straight, corrected), atol=1e-12)


@pytest.mark.parametrize("degrees", [-17.0, 4.0])
def test_a_motion_less_all_of_its_turn_only_leans(degrees: float) -> None:
    rotation = Rotation.from_euler("YXZ", [15.0, 6.0, degrees], degrees=True)
    found = parts(about(rotation, (3.0, -2.0, 8.0)), np.array([0.0, 0.0, 1.0]))
    around = CENTRE + 30.0 * np.vstack([np.zeros(3), np.eye(3)])
    left = fit_rigid(around, found.without(found.axial_rotation, around))
    assert Rotation.from_matrix(left.rotation).as_euler("YXZ", degrees=True) == pytest.approx(
        [15.0, 6.0, 0.0], abs=1e-9
    )
    np.testing.assert_allclose(left.apply(CENTRE), found.motion.apply(CENTRE), atol=1e-9)
    np.testing.assert_allclose(found.without(np.zeros(()), around[1]), found.motion.apply(around[1]), atol=1e-12)


def test_the_turn_of_a_leaning_vertebra_is_found_whichever_way_it_leans() -> None:
    for lean in ((0.0, 0.0), (25.0, 0.0), (-20.0, 15.0)):
        attitude = Rotation.from_euler("YXZ", [*lean, 11.0], degrees=True)
        axis, to_left = attitude.apply([[0.0, 0.0, 30.0], [40.0, 0.0, 0.0]])
        assert np.degrees(axial_turn(axis, to_left, np.array([1.0, 0.0]))) == pytest.approx(11.0, abs=1e-9)
        assert np.degrees(axial_turn(axis, to_left, np.array([0.0, 2.0]))) == pytest.approx(-79.0, abs=1e-9)
