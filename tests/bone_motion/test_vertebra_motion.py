"""A vertebra's motion in parts, which part of its turn goes with its curve, and smoothing along the spine."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_smoothing_spline
from scipy.spatial.transform import Rotation

from support.known_spine import before_and_after, with_errors
from warp_trunk.bone_motion.vertebra_motion import CoupledTurns, VertebraParts, axial_turn, split
from warp_trunk.bone_motion.vertebra_smoothing import (
    VertebraSmoothing,
    likeliest_smoothness,
    roughness_of,
    smoother,
    vertebra_smoothing,
    vertebrae_of,
)
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.rigid import RigidMotion, fit_rigid
from warp_trunk.preparation.deformity import SpineCurve, correct
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.spine.cobb import cobb_angles

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


_, _, STRAIGHT = straight_trunk()
THORACIC = ("T5", "T7", "T8", "T9", "T11")


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
    for level in THORACIC:
        assert found[level] == pytest.approx(-fraction * whole[level], abs=0.3)


def test_derotation_at_the_same_curve_changes_nothing_of_it() -> None:
    curve = SpineCurve(cobb=50.0)
    left = curve.corrected(0.6)
    more = replace(left, apical_rotation=left.rotation - 4.0)
    one, other = coupled(curve, left), coupled(curve, more)
    for level in THORACIC:
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


BEFORE, AFTER = before_and_after()
LEVELS = BEFORE.vertebrae()


def smoothing_of(before: Landmarks, after: Landmarks) -> tuple[VertebraSmoothing | None, Landmarks]:
    """The smoothing that landmarks require, and those after it."""
    bodies, here, there = vertebrae_of(before), before.points[None], after.points[None]
    motions = bodies.fit(here, there)
    found = vertebra_smoothing(bodies, motions[0], before.points, after.points)
    return found, Landmarks(after.names, found.smoothed(bodies, motions, here, there)[0]) if found else after


def tumbling(before: Landmarks, after: Landmarks) -> np.ndarray:
    """How far the motion of each vertebra is turned from the true one [degrees], shape (levels,)."""
    off = []
    for level in LEVELS:
        true = fit_rigid(BEFORE.of_bone(level).points, AFTER.of_bone(level).points)
        found = fit_rigid(before.of_bone(level).points, after.of_bone(level).points)
        off.append(np.degrees((found * true.inv()).angle))
    return np.array(off)


def test_landmarks_that_move_rigidly_stay_as_they_are() -> None:
    assert smoothing_of(BEFORE, AFTER)[0] is None
    assert smoothing_of(BEFORE, Landmarks(AFTER.names, AFTER.points.round(3)))[0] is None
    few = [row for row, name in enumerate(BEFORE.names) if name.startswith(("T1_", "T8_", "L2_"))]
    names = tuple(BEFORE.names[row] for row in few)
    rough = Landmarks(names, AFTER.points[few] * 1.1)
    assert smoothing_of(Landmarks(names, BEFORE.points[few]), rough)[0] is None


def test_errors_are_told_and_nearly_halved() -> None:
    raw, found, errors = [], [], []
    for seed in range(20):
        random = np.random.default_rng(seed)
        before, after = with_errors(BEFORE, random), with_errors(AFTER, random)
        smoothing, smooth = smoothing_of(before, after)
        assert smoothing is not None
        errors.append(smoothing.error)
        raw.append(tumbling(before, after))
        found.append(tumbling(before, smooth))
    stated = np.sqrt(2.0 * (2.1**2 + 1.5**2) / 3.0)  # before and after, each axis
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(stated, rel=0.05)
    assert np.sqrt(np.mean(np.square(found))) < 0.65 * np.sqrt(np.mean(np.square(raw)))


def test_each_vertebra_keeps_its_shape_and_others_their_place() -> None:
    random = np.random.default_rng(3)
    before, after = with_errors(BEFORE, random), with_errors(AFTER, random)
    _, moved = smoothing_of(before, after)
    assert moved.names == after.names
    for level in LEVELS:
        here, there = before.of_bone(level).points, moved.of_bone(level).points
        np.testing.assert_allclose(fit_rigid(here, there).apply(here), there, atol=1e-9)
    for name in ("asis_left", "asis_right"):
        np.testing.assert_array_equal(moved.point(name), after.point(name))


def test_a_kink_that_stands_out_of_the_errors_is_followed() -> None:
    """T8 turned by 40 degrees against its neighbours, landmarks off by 0.3 mm, which is 0.6 degrees."""
    random = np.random.default_rng(5)
    points = AFTER.points.copy()
    rows = [row for row, name in enumerate(AFTER.names) if name.startswith("T8_")]
    middle = points[rows].mean(axis=0)
    turn = Rotation.from_euler("z", 40.0, degrees=True)
    points[rows] = turn.apply(points[rows] - middle) + middle
    kinked = Landmarks(AFTER.names, points + 0.3 * random.normal(size=points.shape))
    wanted = fit_rigid(BEFORE.points[rows], points[rows])
    found = fit_rigid(BEFORE.points[rows], smoothing_of(BEFORE, kinked)[1].points[rows])
    assert np.degrees((found * wanted.inv()).angle) < 3.0


ALONG = np.cumsum(np.random.default_rng(4).uniform(15.0, 30.0, 17))
VARIANCE = np.random.default_rng(5).uniform(0.5, 2.0, 17)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(6)


def test_roughness_is_the_integral_of_the_curvature_squared(random: np.random.Generator) -> None:
    values = random.normal(size=17)
    spline = CubicSpline(ALONG, values, bc_type="natural")
    fine = np.linspace(ALONG[0], ALONG[-1], 200_001)
    wanted = np.trapezoid(np.square(spline(fine, 2)), fine)
    assert values @ roughness_of(ALONG) @ values == pytest.approx(wanted, rel=1e-6)
    np.testing.assert_allclose(roughness_of(ALONG) @ (3.0 + 2.0 * ALONG), 0.0, atol=1e-9)


@pytest.mark.parametrize("smoothness", [1e-2, 1e2, 1e5])
def test_smoothed_values_are_those_of_scipy(random: np.random.Generator, smoothness: float) -> None:
    values = random.normal(size=17)
    wanted = make_smoothing_spline(ALONG, values, w=1.0 / VARIANCE, lam=smoothness)(ALONG)
    found = smoother(smoothness, VARIANCE, roughness_of(ALONG)) @ values
    np.testing.assert_allclose(found, wanted, atol=1e-7)


def test_smoothness_is_likeliest(random: np.random.Generator) -> None:
    """The density of what is left of the values without a straight line: a Gaussian, by its covariance."""
    values = np.sin(ALONG / 60.0) * 3.0 + np.sqrt(VARIANCE) * random.normal(size=17)
    roughness = roughness_of(ALONG)
    line = np.column_stack([np.ones(17), ALONG])
    contrasts = np.linalg.qr(line, mode="complete")[0][:, 2:].T
    wander = np.linalg.pinv(roughness)

    def likelihood(smoothness: float) -> float:
        covariance = contrasts @ (np.diag(VARIANCE) + wander / smoothness) @ contrasts.T
        seen = contrasts @ values
        return -0.5 * float(np.linalg.slogdet(covariance)[1] + seen @ np.linalg.solve(covariance, seen))

    found = likeliest_smoothness(values, VARIANCE, roughness)
    others = found * np.array([0.5, 0.9, 1.1, 2.0, 1e-3, 1e3])
    assert all(likelihood(found) > likelihood(float(other)) for other in others)
